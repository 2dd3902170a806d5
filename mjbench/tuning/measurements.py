"""What a search in C asks for: what there is to try, attempts, and comparisons in fresh processes.

A setting may crash MuJoCo or never return, so each attempt has a process of its own. Its time is
measured within that process, which is good for choosing what to look at again, and for no more.
"""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench import paths
from mjbench.errors import InputError, MachineError
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.loop import profile
from mjbench.measuring import stats, timing
from mjbench.measuring.ratio import Ratio
from mjbench.paired import verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation import models, work
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.tuning import distance, knobs, mesh_notes, observed, reference, trajectories, variants
from mjbench.tuning.mesh_notes import MeshNote
from mjbench.tuning.physics import physics
from mjbench.tuning.records import Accuracy, Attempt, Effect
from mjbench.tuning.reference import HOLD, Baseline, Present, TrialPlan
from mjbench.tuning.settings import (
    NO_CHANGE,
    LoopChange,
    Setting,
    edits_of,
    label,
    loop_change,
)
from mjbench.tuning.trajectories import Trajectories, Trials

# Smallest gain that counts, and the confidence of a comparison.
MIN_EFFECT, CONFIDENCE = 0.01, 0.95
# Seconds of a block that an attempt times, and quads of such blocks.
BLOCK_S, QUADS = 0.002, 25
# Controls of each run in such a block.
BLOCK_NCONTROL = 2
# Seconds of silence after which a child is killed.
SILENCE_S = 120.0
# Seconds that the reference may take: it has many steps.
BASELINE_SILENCE_S = 600.0


def saves_time(ratio: Ratio) -> bool:
    """Return whether settings certainly save time, MIN_EFFECT / 2 at least by estimate."""
    return ratio.high is not None and ratio.high < 1 and ratio.estimate <= 1 - MIN_EFFECT / 2


@dataclass(frozen=True)
class Survey:
    """What there is to try on a model."""

    settings: Sequence[Setting]
    meshes: Sequence[MeshNote]


class CMeasurements:
    """Measures a model in C on this machine.

    Files of models and trials last as long as the pool. A model that cannot be loaded, or diverges,
    is an InputError; a process that crashes or hangs, but in an attempt, is a MachineError.
    """

    def __init__(
        self,
        pool: WorkerPool,
        source: ModelSource,
        starts: StartPlan,
        hold: int = HOLD,
        limit_s: float = SILENCE_S,
    ):
        """Measure nothing yet."""
        self._pool, self._source, self._starts = pool, source, starts
        self._hold, self._limit_s = hold, limit_s
        self._baseline_file, self._model_file = pool.new_file(".pickle"), pool.new_file(".mjb")
        self._changed: dict[str, Path] = {}  # the changed model, by the label of settings

    def survey(self, seed: int) -> Survey:
        """Return what there is to try on the model."""
        arguments = self._source, seed, self._starts, self._hold
        return isolate.call(look, *arguments, limit_s=self._limit_s)

    def stages(self) -> Mapping[str, float] | None:
        """Return the share of a step by stage; None where it cannot be measured."""
        try:
            arguments = self._source, self._starts
            return isolate.call(profile.step, *arguments, limit_s=self._limit_s).stages
        except (InputError, MachineError):
            return None

    def baseline(self, plan: TrialPlan) -> Present:
        """Draw trials, and return what the present settings do; attempts use them from then on."""
        return isolate.call(
            run_baseline,
            self._source,
            plan,
            self._baseline_file,
            self._model_file,
            limit_s=max(BASELINE_SILENCE_S, self._limit_s),
        )

    def attempt(
        self, settings: tuple[Setting, ...], nrun: int | None = None, quads: int = QUADS
    ) -> Attempt:
        """Return how settings do; a crash, a hang or a divergence is a status.

        Args:
          nrun: runs of the trials to do, the first ones; None for all.
          quads: blocks to time, as quads; 0 to measure no time.
        """
        file = None
        if nrun is None:  # it may be compared
            file = self._changed.get(label(settings)) or self._pool.new_file(".mjb")
            self._changed[label(settings)] = file
        return isolate.call(
            run_attempt,
            self._source,
            self._baseline_file,
            settings,
            file,
            nrun,
            quads,
            limit_s=self._limit_s,
            otherwise=lambda ended: Attempt(settings, ended.status, ended.detail),
        )

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


# -- in a child ----------------------------------------------------------------------------------


def look(source: ModelSource, seed: int, starts: StartPlan, hold: int, channel: Channel) -> Survey:
    """Step the model, and return what there is to try."""
    channel.doing(f"stepping {source.name}")
    seen = observed.observe(source, seed, starts, hold)
    settings = [setting for of_knob in knobs.settings(seen).values() for setting in of_knob]
    return Survey(settings, mesh_notes.mesh_notes(seen.model))


def run_baseline(
    source: ModelSource, plan: TrialPlan, file: Path, model_file: Path, channel: Channel
) -> Present:
    """Run the present settings and the reference; write them, and the model, to files."""
    channel.doing(f"running {source.name} with its present settings")
    model = variants.compiled(source, ())
    baseline = reference.baseline(model, plan)
    file.write_bytes(pickle.dumps(baseline))
    models.save(model, model_file)
    return baseline.facts


def run_attempt(
    source: ModelSource,
    baseline_file: Path,
    settings: tuple[Setting, ...],
    model_file: Path | None,
    nrun: int | None,
    quads: int,
    channel: Channel,
) -> Attempt:
    """Try settings; save the changed model to a file, unless it is None."""
    channel.doing("applying the settings")
    baseline: Baseline = pickle.loads(baseline_file.read_bytes())
    if nrun is not None:
        baseline = baseline.only(nrun)
    model = variants.compiled(source, ())
    changed = variants.compiled(source, edits_of(settings))
    channel.doing("running the model")
    runs = trajectories.run(changed, baseline.trials)
    if runs.diverged.any():
        raise InputError(f"diverges in {int(runs.diverged.sum())} of {len(runs.diverged)} runs")
    accuracy = judged(model, baseline, runs)
    if model_file is not None:
        models.save(changed, model_file)
    loop = loop_change(settings)
    if loop != NO_CHANGE and len(settings) == 1:  # known to change nothing with others
        _check_loop(changed, loop, baseline.trials, runs)
    channel.doing("timing the model")
    ratio = _time_ratio(model, changed, loop, baseline.trials, quads) if quads else None
    return Attempt(settings, Status.OK, "", accuracy, ratio)


def judged(model: mujoco.MjModel, baseline: Baseline, runs: Trajectories) -> Accuracy:
    """Return what settings do to the motion."""
    ncontrol, scale = baseline.facts.horizon_ncontrol, baseline.motion
    within, present = runs.first(ncontrol), baseline.present.first(ncontrol)
    apart = distance.distance(model, scale, within, present)
    if runs.is_identical(baseline.present):
        effect = Effect.FREE
    else:
        over_time = distance.bounds_over_time(model, scale, within, present)
        is_near = bool(np.all(over_time <= baseline.unavoidable))
        is_near = is_near and apart.share <= baseline.facts.error.share
        effect = Effect.EQUIVALENT if is_near else Effect.APPROXIMATE
    return Accuracy(
        effect,
        distance.distance(model, scale, within, baseline.reference),
        apart,
        physics(model, baseline.trials.initial_state, runs.points),
        distance.shares(model, scale, within, baseline.reference).tolist(),
    )


def _time_ratio(
    model: mujoco.MjModel, changed: mujoco.MjModel, loop: LoopChange, trials: Trials, quads: int
) -> float:
    """Return the time of a simulated second with other settings over that with present ones.

    Both do the same number of steps from the same states under the same controls.
    """
    path = paths.find(loop.path)
    ncontrol = min(BLOCK_NCONTROL, trials.ncontrol)
    hold = trajectories.steps_per_control(model, trials.control_s)
    run_s = ncontrol * hold * work.step_s(model, trials.initial_state[0])
    nrun = int(np.clip(BLOCK_S / run_s, 1, trials.nrun))
    rows = np.linspace(0, trials.nrun - 1, nrun).astype(int)
    drawn = trials.only(rows).first(ncontrol)
    present = _prepared(model, drawn, hold, path, {})
    other = _prepared(changed, drawn, hold, path, loop.options)
    for each in (present, other):
        each.run()
    orders = timing.draw_orders(quads)
    seconds = np.array(timing.block_times(present.run, other.run, orders))
    of_steps = float(np.exp(stats.paired_log_ratio(orders, seconds)))
    return of_steps * float(model.opt.timestep) / float(changed.opt.timestep)


def _check_loop(
    model: mujoco.MjModel, loop: LoopChange, trials: Trials, runs: Trajectories
) -> None:
    """Refuse a change of the loop with which it reaches other states."""
    hold = trajectories.steps_per_control(model, trials.control_s)
    prepared = _prepared(model, trials, hold, paths.find(loop.path), loop.options)
    if not np.array_equal(prepared.verified_states().values, runs.points[:, -1]):
        raise InputError("the loop reaches other final states with it")


def _prepared(
    model: mujoco.MjModel,
    trials: Trials,
    hold: int,
    path: paths.SteppingPath,
    options: Mapping[str, str | int],
) -> paths.Prepared:
    """Return what does the trials by a path."""
    drawn = Workload(model, trials.initial_state.copy(), trials.control.copy(), hold, 0)
    reason = path.cannot_run(drawn, options)
    if reason:
        raise InputError(reason)
    return path.prepare(drawn, path.complete(options), paths.Resources(drawn))
