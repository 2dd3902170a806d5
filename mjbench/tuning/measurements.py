"""What a search asks for: what there is to try, attempts, and comparisons in fresh processes."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench import paths
from mjbench.errors import InputError, MachineError
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.loop import profile
from mjbench.loop.loop_starts import LoopRequest
from mjbench.measuring.ratio import Ratio
from mjbench.paired import verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning import attempts, knobs, mesh_notes, observed
from mjbench.tuning.attempts import AttemptRequest, BaselineRequest
from mjbench.tuning.mesh_notes import MeshNote
from mjbench.tuning.records import Attempt
from mjbench.tuning.reference import HOLD, Present, TrialPlan
from mjbench.tuning.settings import Setting, label, loop_change

# Smallest gain that counts, and the confidence of a comparison.
MIN_EFFECT, CONFIDENCE = 0.01, 0.95


def saves_time(ratio: Ratio) -> bool:
    """Return whether settings certainly save time, MIN_EFFECT / 2 at least by estimate."""
    return ratio.high is not None and ratio.high < 1 and ratio.estimate <= 1 - MIN_EFFECT / 2


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


class OnThisMachine:
    """Measures a model here.

    Files of models and trials last as long as the pool. A model that cannot be loaded, or diverges,
    is an InputError; a process that crashes or hangs, but in an attempt, is a MachineError.
    """

    def __init__(
        self,
        pool: WorkerPool,
        source: ModelSource,
        starts: StartPlan,
        hold: int = HOLD,
        limit_s: float = attempts.SILENCE_S,
    ):
        """Measure nothing yet."""
        self._pool, self._source, self._starts = pool, source, starts
        self._hold, self._limit_s = hold, limit_s
        self._baseline_file, self._model_file = pool.new_file(".pickle"), pool.new_file(".mjb")
        self._changed: dict[str, Path] = {}  # the changed model, by the label of settings

    def survey(self, seed: int) -> Survey:
        """Return what there is to try on the model."""
        messages: list[Survey] = []
        request = SurveyRequest(self._source, seed, self._starts, self._hold)
        task = "mjbench.tuning.measurements:look"
        isolate.run(task, request, messages.append, self._limit_s).check()
        profiles: list[profile.StepTimes] = []
        loop = LoopRequest(self._source, self._starts)
        with contextlib.suppress(InputError, MachineError):
            isolate.run("mjbench.loop.profile:step", loop, profiles.append, self._limit_s)
        return replace(messages[0], stages=profiles[0].stages if profiles else None)

    def baseline(self, plan: TrialPlan) -> Present:
        """Draw trials, and return what the present settings do; attempts use them from then on."""
        request = BaselineRequest(self._source, plan, self._baseline_file, self._model_file)
        return attempts.measure_baseline(request, self._limit_s)

    def attempt(
        self, settings: tuple[Setting, ...], nrun: int | None = None, quads: int = attempts.QUADS
    ) -> Attempt:
        """Return how settings do on the first of the trials; on all, by default."""
        file = None
        if nrun is None:  # it may be compared
            file = self._changed.get(label(settings)) or self._pool.new_file(".mjb")
        request = AttemptRequest(self._source, self._baseline_file, settings, file, nrun, quads)
        done = attempts.attempt(request, self._limit_s)
        if file is not None:
            self._changed[label(settings)] = file
        return done

    def compare(
        self, settings: tuple[Setting, ...], seed: int, time_limit_s: float
    ) -> VerdictRecord:
        """Return how much faster settings are, in fresh processes; they were attempted before."""
        release = installs.parse_release(installs.INSTALLED)
        loop = loop_change(settings)
        path = paths.find(loop.path)
        name, file = self._source.name, self._changed[label(settings)]
        baseline, candidate = (
            Target(release, ModelSource(name, model), path.name, path.complete(options))
            for model, options in ((self._model_file, {}), (file, loop.options))
        )
        plan = VerdictPlan(
            MIN_EFFECT,
            CONFIDENCE,
            MIN_EFFECT / 2,
            time_limit_s,
            Sizes(seed=seed, starts=self._starts, hold=self._hold),
            as_shipped=True,  # one build against itself
        )
        try:
            result = verdict.decide(self._pool, baseline, candidate, plan)
        finally:
            file.unlink(missing_ok=True)  # models may be large
        if result.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        return result.record()


def look(request: SurveyRequest, channel: Channel) -> None:
    """Step the model, and see what there is to try; runs in a child."""
    channel.doing(f"stepping {request.source.name}")
    seen = observed.observe(request.source, request.seed, request.starts, request.hold)
    settings = [setting for of_knob in knobs.settings(seen).values() for setting in of_knob]
    channel.send(Survey(settings, mesh_notes.mesh_notes(seen.model)))
