"""What there is to try on a model: settings, stages of its step, meshes; in a child process."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
    """Asks a child what there is to try."""

    source: ModelSource
    seed: int
    starts: StartPlan
    hold: int


@dataclass(frozen=True)
class Survey:
    """What there is to try on a model.

    Attributes:
      stages: share of a step by stage; None where it cannot be measured.
    """

    settings: Sequence[Setting]
    meshes: Sequence[MeshNote]
    stages: Mapping[str, float] | None = None


def survey(request: SurveyRequest, limit_s: float = SILENCE_S) -> Survey:
    """Return what there is to try on a model."""
    messages: list[Survey] = []
    isolate.run("mjbench.tuning.survey:look", request, messages.append, limit_s).check()
    profiles: list[profile.StepTimes] = []
    loop = LoopRequest(request.source, request.starts)
    with contextlib.suppress(InputError, MachineError):
        isolate.run("mjbench.loop.profile:step", loop, profiles.append, limit_s)
    return replace(messages[0], stages=profiles[0].stages if profiles else None)


def look(request: SurveyRequest, channel: Channel) -> None:
    """Step the model, and see what there is to try; runs in a child."""
    channel.doing(f"stepping {request.source.name}")
    seen = observed.observe(request.source, request.seed, request.starts, request.hold)
    settings = [setting for of_knob in knobs.settings(seen).values() for setting in of_knob]
    channel.send(Survey(settings, mesh_notes.mesh_notes(seen.model)))
