"""Merge run files and sets into one set: every run once, to the byte, nothing averaged."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.instrument import run_set
from mjbench.instrument.run_set import RunSet, RunSetFile, Section
from mjbench.instrument.runs import Run


@dataclass(frozen=True)
class Merged:
    """What a merge came to.

    Attributes:
      runs: of the set afterwards, each once.
      repeated: sections of the inputs that the set had already.
      earlier: sections that are an earlier state of a run in the set.
      torn: inputs whose last section was cut short, and left out.
    """

    runs: tuple[Run, ...]
    added: int
    repeated: int
    earlier: int
    torn: tuple[Path, ...]


def merge(inputs: Sequence[Path], output: Path, record_types: Mapping[str, type]) -> Merged:
    """Append the runs of files to a set, which is created where there is none.

    All inputs are read before anything is written.

    Args:
      output: may be an input, too.

    Raises:
      InputError: an input is neither a run file nor a set, or the output is a file but no set.
      MachineError: the output cannot be written, or another process writes it.
    """
    read = [run_set.read(path, record_types) for path in inputs]
    # not Path.exists, which fails where a name is too long; create has a message for that
    open_set = RunSetFile.open if os.path.lexists(output) else RunSetFile.create
    file = open_set(output)
    try:
        held = list(run_set.read(output, record_types).sections)
        choice = _choose([section for each in read for section in each.sections], held)
        for section in choice.added:
            file.append(section)
    finally:
        file.close()
    return Merged(
        RunSet((*held, *choice.added)).runs,
        len(choice.added),
        choice.repeated,
        choice.earlier,
        tuple(path for path, each in zip(inputs, read, strict=True) if each.is_torn),
    )


@dataclass(frozen=True)
class _Choice:
    """Which sections are appended, and how many are not, and why; see `Merged`."""

    added: tuple[Section, ...]
    repeated: int
    earlier: int


def _choose(given: Sequence[Section], held: Sequence[Section]) -> _Choice:
    """Return which of the given sections a set lacks."""
    known = {section.sha256 for section in held}
    new = {section.sha256: section for section in given if section.sha256 not in known}
    latest = {section.sha256 for section in run_set.distinct((*held, *new.values()))}
    added = tuple(section for sha256, section in new.items() if sha256 in latest)
    return _Choice(added, len(given) - len(new), len(new) - len(added))
