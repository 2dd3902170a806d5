"""What a search in C asks for: what there is to try, the present runs, the reference, launches.

Whatever steps the model runs in a process of its own: a setting may crash MuJoCo or never return.
"""

import math
import pickle
import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from mjbench.commands.tune import edited_model, knobs, mesh_notes, reference, usual_regime
from mjbench.commands.tune.mesh_notes import MeshNote
from mjbench.commands.tune.reference import HOLD, Baseline, Present, TrialPlan
from mjbench.commands.tune.result import Attempt, fresh_ratio, log_ratio
from mjbench.commands.tune.setting_launch import (
    SearchFiles,
    SettingLaunchRequest,
    run_launch,
    stage_shares,
)
from mjbench.commands.tune.settings import Setting, Settings
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.paired.launches import StopRule, Targets
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status

# Seconds of silence after which a child is killed.
SILENCE_S = 120.0
# A launch of a few settings takes at least this share of the time of one of all: it starts a
# process.
SHARE_OF_START = 0.25

# Seconds that the present runs and the reference may take at least: they have many steps.
RUNS_SILENCE_S = 600.0


class CMeasurements:
    """Measures a model in C on this machine.

    Files of models and trials last as long as the pool. A model that cannot be loaded, or diverges,
    is an InputError; a process that crashes or hangs, but for a setting, is a MachineError.
    """

    def __init__(
        self,
        pool: WorkerPool,
        source: ModelSource,
        starts: StartPlan,
        hold: int = HOLD,
        limit_s: float = SILENCE_S,
    ):
        self._source = ModelSource(source.name, source.path.resolve())
        self._starts, self._hold = starts, hold
        self._limit_s, self._long_s = limit_s, max(RUNS_SILENCE_S, limit_s)
        model, baseline = pool.new_file(".mjb"), pool.new_file(".pickle")
        self._files = SearchFiles(model, baseline, pool.new_folder())

    def survey(self, seed: int, computing_s: float) -> tuple[Sequence[Setting], Sequence[MeshNote]]:
        """Return what there is to try, and meshes that nearly fill a primitive."""
        plan = seed, self._starts, self._hold, computing_s
        return isolate.call(look, self._source, *plan, limit_s=self._limit_s)

    def present(self, plan: TrialPlan) -> tuple[Present, Mapping[str, float], float]:
        """Draw the trials of launches; return what the present settings do from there.

        Returns:
          That, the share of a step by stage, and the seconds that the reference takes at least.
        """
        return isolate.call(run_present, self._source, plan, self._files, limit_s=self._long_s)

    def reference(self, horizon_ncontrol: int | None = None) -> Present:
        """Run the reference, to a horizon if there is one; return what the present settings do."""
        files = self._files, horizon_ncontrol
        return isolate.call(run_reference, self._source, *files, limit_s=self._long_s)

    def launch(self, request: SettingLaunchRequest) -> list[Attempt]:
        """Try settings, one after the other, in a fresh process; return those that were begun.

        One that crashes, hangs or diverges has a status, no more. After one that ends the process,
        the others go on in another process.
        """
        begun: list[Attempt] = []
        end_s, left = time.monotonic() + request.stop_after_s, list(request.settings)

        def receive(attempt: Attempt) -> None:
            left.pop(0)
            begun.append(attempt)

        while left:
            still = replace(request, settings=tuple(left), stop_after_s=end_s - time.monotonic())
            task = self._source, self._files, still
            ended = isolate.run(run_launch, task, receive, self._limit_s)
            if ended.position is None:  # it ended well, or without a setting to blame
                ended.check()
                break
            if left:
                receive(Attempt(left[0], ended.status, ended.detail))
        return begun


# -- launches until a rule has enough ------------------------------------------------------------

SettingLaunch = Mapping[int, Attempt]


@dataclass
class SettingTargets(Targets[SettingLaunch]):
    """Settings to time; each launch has them in an order of its own, and new starts.

    The first one keeps the order, in which the likely gains come first: time may run out.
    """

    try_settings: Callable[[SettingLaunchRequest], Sequence[Attempt]]
    settings: Sequence[Settings]
    timed_s: float
    left_s: Callable[[], float]
    rng: random.Random
    is_first: bool = True

    def launch(self, positions: Sequence[int]) -> SettingLaunch:
        """See `Targets.launch`; a setting that fails has a status."""
        order = list(positions)
        if not self.is_first:
            self.rng.shuffle(order)
        self.is_first = False
        settings, seed = [self.settings[i] for i in order], self.rng.randrange(2**31)
        request = SettingLaunchRequest(
            settings, self.timed_s, seed=seed, stop_after_s=self.left_s()
        )
        return dict(zip(order, self.try_settings(request), strict=False))


@dataclass
class SettingRule(StopRule[SettingLaunch]):
    """Launch settings a number of times, or until time is up; those that fail leave.

    Attributes:
      least: launches that are begun in any case.
      end_s: after the least, no launch is begun that would end later than this, by `clock`.
      stays: whether a setting is in the next launch, after its launches so far.
    """

    count: int
    least: int
    most: int
    end_s: float
    clock: Callable[[], float]
    stays: Callable[[Sequence[Attempt]], bool] = lambda attempts: True
    attempts: dict[int, list[Attempt]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._left = list(range(self.count))
        self._begin_s = self._launch_s = 0.0
        self._ndone = 0

    def next_targets(self) -> Sequence[int]:
        self._begin_s = self.clock()
        is_late = self._begin_s + self._launch_s > self.end_s
        if self._ndone >= self.most or (self._ndone >= self.least and is_late):
            return []
        return self._left

    def add(self, launch: SettingLaunch) -> None:
        """See `StopRule.add`; settings that were not begun in time leave."""
        before = len(self._left)
        for position, attempt in launch.items():
            self.attempts.setdefault(position, []).append(attempt)
        self._left = [
            i
            for i in self._left
            if i in launch and launch[i].status == Status.OK and self.stays(self.attempts[i])
        ]
        spent_s = self.clock() - self._begin_s
        self._launch_s = spent_s * max(len(self._left) / max(1, before), SHARE_OF_START)
        self._ndone += 1


def together_known(attempts: Sequence[Attempt]) -> Attempt:
    """Return what several launches of a setting say: the median of its time, or how it failed."""
    last = attempts[-1]
    if last.status != Status.OK:
        return last
    rows = [each.samples for each in attempts if each.samples]
    ratio = math.exp(statistics.median(log_ratio(row) for row in rows))
    return replace(last, time_ratio=ratio, samples=None, launches=rows)


def with_accuracy(attempt: Attempt, seen: Attempt) -> Attempt:
    if seen.status != Status.OK:
        return Attempt(attempt.settings, seen.status, seen.detail)
    return replace(attempt, accuracy=seen.accuracy, stages=seen.stages)


def with_figures(attempt: Attempt, launched: Sequence[Attempt]) -> Attempt:
    """Return an attempt with the ratio of launches that did not choose it."""
    known = together_known(launched)
    if known.status != Status.OK:
        return Attempt(attempt.settings, known.status, known.detail)
    ratio = fresh_ratio(known.launches)
    return replace(attempt, time_ratio=ratio.estimate, ratio=ratio, launches=known.launches)


# -- in a child ----------------------------------------------------------------------------------


def look(
    source: ModelSource,
    seed: int,
    starts: StartPlan,
    hold: int,
    computing_s: float,
    channel: Channel,
) -> tuple[Sequence[Setting], Sequence[MeshNote]]:
    channel.doing(f"stepping {source.name}")
    seen = usual_regime.observe_model(
        models.load(source), usual_regime.is_mjcf(source.path), seed, starts, hold, computing_s
    )
    settings = [setting for of_knob in knobs.settings(seen).values() for setting in of_knob]
    return settings, mesh_notes.mesh_notes(seen.model)


def run_present(
    source: ModelSource, plan: TrialPlan, files: SearchFiles, channel: Channel
) -> tuple[Present, Mapping[str, float], float]:
    channel.doing(f"running {source.name} with its present settings")
    model = edited_model.compiled(source, ())
    baseline = reference.present_runs(model, plan)
    files.baseline.write_bytes(pickle.dumps(baseline))
    models.save(model, files.model)
    stages = stage_shares(model, baseline.trials)
    return baseline.facts, stages, reference.seconds(model, baseline.trials)


def run_reference(
    source: ModelSource, files: SearchFiles, horizon_ncontrol: int | None, channel: Channel
) -> Present:
    channel.doing(f"running the reference of {source.name}")
    model = models.load(ModelSource(source.name, files.model))
    baseline: Baseline = pickle.loads(files.baseline.read_bytes())
    baseline = reference.with_reference(model, baseline, horizon_ncontrol)
    files.baseline.write_bytes(pickle.dumps(baseline))
    return baseline.facts
