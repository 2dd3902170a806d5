"""Write a copy of the user's MJCF with settings, in a child process: it compiles the model."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError
from mjbench.instrument import isolate
from mjbench.instrument.isolate import Channel
from mjbench.simulation.models import ModelSource
from mjbench.tuning import variants
from mjbench.tuning.attempts import SILENCE_S
from mjbench.tuning.settings import Edit


@dataclass(frozen=True)
class CopyRequest:
    """Asks a child for a copy.

    Attributes:
      edits: of the copy; None only to see whether one could be written.
      target: file to write, absolute.
    """

    source: ModelSource
    edits: Sequence[Edit] | None
    target: Path


def check_source(source: ModelSource) -> None:
    """Refuse a model of which no copy can be written, as far as its name tells.

    Raises:
      InputError: it is no MJCF.
    """
    if source.path.suffix.lower() != ".xml":
        raise InputError(f"--write: {source.name} is no MJCF file: give the one it comes from")


def check_target(source: ModelSource, target: Path, limit_s: float = SILENCE_S) -> None:
    """Refuse a file that a copy could not be written to.

    Raises:
      InputError: a copy there would not be the model (see `variants.write`).
      MachineError: the file cannot be written, or the process crashed or hung.
    """
    request = CopyRequest(source, None, target.absolute())
    isolate.run("mjbench.tuning.model_copy:run", request, lambda _: None, limit_s).check()


def write(
    source: ModelSource, edits: Sequence[Edit], target: Path, limit_s: float = SILENCE_S
) -> None:
    """Write a copy of an MJCF file with edits applied, complete or not at all.

    Raises:
      InputError: the copy cannot be the model that was measured (see `variants.write`).
      MachineError: the file cannot be written, or the process crashed or hung.
    """
    request = CopyRequest(source, tuple(edits), target.absolute())
    isolate.run("mjbench.tuning.model_copy:run", request, lambda _: None, limit_s).check()


def run(request: CopyRequest, channel: Channel) -> None:
    """Write a copy, or see whether one could be written; runs in a child."""
    channel.doing(f"writing {request.target}")
    if request.edits is None:
        variants.check_target(request.source, request.target)
    else:
        variants.write(request.source, request.edits, request.target)
