"""What there is to try on a model: settings, stages of its step, meshes; in a child process."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjbench.errors import InputError, MachineError
from mjbench.instrument import isolate
from mjbench.instrument.isolate import Channel
from mjbench.loop import profile
from mjbench.loop.loop_starts import LoopRequest
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.tuning import knobs, mesh_notes, observed
from mjbench.tuning.attempts import SILENCE_S
from mjbench.tuning.mesh_notes import MeshNote
from mjbench.tuning.settings import Setting


@dataclass(frozen=True)
class SurveyRequest:
    """Asks a child what there is to try.

    Attributes:
      hold: steps for which each control is held.
    """

    source: ModelSource
    seed: int
    starts: StartPlan
    hold: int


@dataclass(frozen=True)
class Survey:
    """What there is to try on a model.

    Attributes:
      settings: of all knobs, that differ from the model's own.
      meshes: that collide, and that nearly fill a primitive.
    """

    settings: Sequence[Setting]
    meshes: Sequence[MeshNote]


def survey(request: SurveyRequest, limit_s: float = SILENCE_S) -> Survey:
    """Return what there is to try on a model.

    Raises:
      InputError: it cannot be loaded, or diverges.
      MachineError: the process that steps it crashed or hung.
    """
    messages: list[Survey] = []
    isolate.run("mjbench.tuning.survey:look", request, messages.append, limit_s).check()
    return messages[0]


def stages(
    source: ModelSource, starts: StartPlan, limit_s: float = SILENCE_S
) -> Mapping[str, float] | None:
    """Return the share of a step by stage; None where it cannot be measured."""
    messages: list[profile.StepTimes] = []
    request = LoopRequest(source, starts)
    try:
        isolate.run("mjbench.loop.profile:step", request, messages.append, limit_s).check()
    except (InputError, MachineError):
        return None
    return messages[0].stages


def look(request: SurveyRequest, channel: Channel) -> None:
    """Step the model, and see what there is to try; runs in a child."""
    channel.doing(f"stepping {request.source.name}")
    seen = observed.observe(request.source, request.seed, request.starts, request.hold)
    settings = [setting for of_knob in knobs.settings(seen).values() for setting in of_knob]
    channel.send(Survey(settings, mesh_notes.mesh_notes(seen.model)))
