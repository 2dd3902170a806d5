"""What a search in C asks for: what there is to try, the present runs, the reference, launches.

Whatever steps the model runs in a process of its own: a setting may crash MuJoCo or never return.
"""

import math
import pickle
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from mjbench.commands.profile import model_costs
from mjbench.commands.profile.model_costs import Cost
from mjbench.commands.tune import edited_model, knobs, reference, usual_regime
from mjbench.commands.tune.reference import HOLD, Baseline, CurrentSettings, TrialPlan
from mjbench.commands.tune.result import Attempt, fresh_ratio, log_ratio
from mjbench.commands.tune.setting_launch import (
    SearchFiles,
    SettingLaunchRequest,
    run_launch,
    step_stages,
)
from mjbench.commands.tune.settings import Setting
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status

# Seconds of silence after which a child is killed.
SILENCE_S = 120.0
# Seconds that the present runs and the reference may take at least: they have many steps.
RUNS_SILENCE_S = 600.0
# Seconds to time collisions of geoms.
COLLISION_S = 0.3


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

    def survey(self, seed: int, computing_s: float) -> Sequence[Setting]:
        """Return what there is to try."""
        plan = seed, self._starts, self._hold, computing_s
        return isolate.call(look, self._source, *plan, limit_s=self._limit_s)

    def present(
        self, plan: TrialPlan
    ) -> tuple[CurrentSettings, Mapping[str, float], Cost | None, float]:
        """Draw the trials of launches; return what the present settings do from there.

        Returns:
          That, the share of a step by stage, what collisions of height fields or meshes cost, and
          the seconds that the reference takes at least.
        """
        return isolate.call(run_present, self._source, plan, self._files, limit_s=self._long_s)

    def reference(self, horizon_ncontrol: int | None = None) -> CurrentSettings:
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


# -- what launches say together -----------------------------------------------------------------


def summary(attempts: Sequence[Attempt]) -> Attempt:
    """Return what several launches of a setting say: the median of its time, or how it failed."""
    last = attempts[-1]
    if last.status != Status.OK:
        return last
    rows = [row for each in attempts for row in each.launches]
    ratio = math.exp(statistics.median(log_ratio(row) for row in rows))
    return replace(last, time_ratio=ratio, launches=rows)


def with_figures(attempt: Attempt, launched: Sequence[Attempt]) -> Attempt:
    """Return an attempt with the ratio of launches that did not choose it."""
    known = summary(launched)
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
) -> Sequence[Setting]:
    channel.doing(f"stepping {source.name}")
    seen = usual_regime.observe_model(
        models.load(source), usual_regime.is_mjcf(source.path), seed, starts, hold, computing_s
    )
    return [setting for of_knob in knobs.settings(seen).values() for setting in of_knob]


def run_present(
    source: ModelSource, plan: TrialPlan, files: SearchFiles, channel: Channel
) -> tuple[CurrentSettings, Mapping[str, float], Cost | None, float]:
    channel.doing(f"running {source.name} with its present settings")
    model = edited_model.compiled(source, ())
    baseline = reference.present_runs(model, plan)
    files.baseline.write_bytes(pickle.dumps(baseline))
    models.save(model, files.model)
    step = step_stages(model, baseline.trials)
    states = baseline.trials.initial_state
    costs = model_costs.collision_costs(model, states, step.shares, step.step_s, COLLISION_S)
    collision = next((cost for cost in costs if cost.detail), None)
    return baseline.facts, step.shares, collision, reference.seconds(model, baseline.trials)


def run_reference(
    source: ModelSource, files: SearchFiles, horizon_ncontrol: int | None, channel: Channel
) -> CurrentSettings:
    channel.doing(f"running the reference of {source.name}")
    model = models.load(ModelSource(source.name, files.model))
    baseline: Baseline = pickle.loads(files.baseline.read_bytes())
    baseline = reference.with_reference(model, baseline, horizon_ncontrol)
    files.baseline.write_bytes(pickle.dumps(baseline))
    return baseline.facts
