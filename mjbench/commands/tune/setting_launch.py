"""A launch of settings: a fresh process that times each beside the present ones, or runs it.

A block of a setting simulates the same time under the same controls as one of the present settings,
so a ratio of their times is of a simulated second, whatever the timesteps are. A setting that
crashes MuJoCo or never returns ends the process; the parent begins another one after it.
"""

import functools
import hashlib
import math
import pickle
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from mjbench import paths
from mjbench.commands.profile import measure as profile
from mjbench.commands.profile import step_parts
from mjbench.commands.profile.loop_starts import StartsInTurn
from mjbench.commands.profile.step_parts import StepStages
from mjbench.commands.tune import accuracy, edited_model, trajectories
from mjbench.commands.tune.reference import LEAST_NCONTROL, SAME_SHARE, Baseline
from mjbench.commands.tune.result import Accuracy, Attempt, Effect, log_ratio
from mjbench.commands.tune.settings import (
    NO_CHANGE,
    LoopChange,
    Settings,
    edits_of,
    label,
    loop_change,
)
from mjbench.commands.tune.trajectories import SensorChange, Trajectories, Trials
from mjbench.errors import InputError, failure_of
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.paired.records import LaunchRow
from mjbench.simulation import models, reference_run
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload
from mjbench.status import Status

# Seconds of a block; controls of each of its runs, and runs at least, unless one takes longer.
BLOCK_S, BLOCK_NCONTROL, LEAST_NRUN = 0.002, 2, 2
# Quads of blocks that a setting gets in a launch, at least and at most.
LEAST_QUADS, MOST_QUADS = 1, 25
# Seconds for the stages of a step that calls time, for each kind of them.
STAGES_S = 0.05


@dataclass(frozen=True)
class SearchFiles:
    """The model with the present settings, a pickled `Baseline`, and a folder of changed models."""

    model: Path
    baseline: Path
    folder: Path


@dataclass(frozen=True)
class SettingLaunchRequest:
    """What a launch is to do.

    Attributes:
      timed_s: seconds for which each setting is timed; 0 not to time any.
      nrun: runs of the trials to compare, from first to last; 0 for none, None for all.
      seed: draws the starts of timed blocks.
      has_stages: whether to measure the stages of a step.
      stop_after_s: seconds after which no other setting is begun.
    """

    settings: Sequence[Settings]
    timed_s: float = 0.0
    nrun: int | None = 0
    seed: int = 0
    has_stages: bool = False
    stop_after_s: float = math.inf


def run_launch(
    source: ModelSource, files: SearchFiles, request: SettingLaunchRequest, channel: Channel
) -> None:
    """Send an `Attempt` for each setting that is begun in time; runs in a child."""
    end_s = time.perf_counter() + request.stop_after_s
    channel.doing(f"loading {source.name}")
    baseline: Baseline = pickle.loads(files.baseline.read_bytes())
    if request.nrun:
        baseline = baseline.only(request.nrun)
    model = models.load(ModelSource(source.name, files.model))
    trying = _Launch(source, files, request, baseline, model)
    for number, settings in enumerate(request.settings):
        if time.perf_counter() > end_s:
            break
        channel.doing(f"trying {label(settings)}", number)
        try:
            tried = trying.attempt(settings)
        except (InputError, mujoco.FatalError) as error:
            failure = failure_of(error)
            tried = Attempt(settings, failure.status, failure.detail)
        channel.send(tried)


@dataclass(frozen=True, eq=False)
class _Launch:
    source: ModelSource
    files: SearchFiles
    request: SettingLaunchRequest
    baseline: Baseline
    model: mujoco.MjModel

    def attempt(self, settings: Settings) -> Attempt:
        changed, loop = self._changed(settings), loop_change(settings)
        attempt = Attempt(settings, Status.OK)
        if self.request.nrun != 0:
            attempt = replace(attempt, accuracy=self._accuracy(settings, changed, loop))
        if self.request.has_stages and loop == NO_CHANGE:  # without its timer, a step tells none
            stages = step_stages(changed, self.baseline.trials).shares
            attempt = replace(attempt, stages=stages)
        if self.request.timed_s:
            samples = self._timed(changed, loop)
            ratio = math.exp(log_ratio(samples))
            attempt = replace(attempt, time_ratio=ratio, launches=[samples])
        return attempt

    def _changed(self, settings: Settings) -> mujoco.MjModel:
        """Return the model with settings; what has to be compiled is compiled once."""
        edits = edits_of(settings)
        compiled = [edit for edit in edits if not edit.is_of_options]
        model = self.model
        if compiled:
            key = hashlib.sha256(repr(compiled).encode()).hexdigest()
            file = self.files.folder / f"{key}.mjb"
            if not file.is_file():
                models.save(edited_model.compiled(self.source, compiled), file)
            model = models.load(ModelSource(self.source.name, file))
        return edited_model.with_options(self.source, model, [e for e in edits if e.is_of_options])

    @functools.cached_property
    def _step_s(self) -> float:
        return reference_run.step_s(self.model, self.baseline.trials.initial_state[0])

    def _accuracy(self, settings: Settings, changed: mujoco.MjModel, loop: LoopChange) -> Accuracy:
        trials = self.baseline.trials
        runs = trajectories.run(changed, trials)
        if runs.diverged.any():
            raise InputError(
                f"diverges in {int(runs.diverged.sum())} of {len(runs.diverged)} simulations"
            )
        if loop != NO_CHANGE and len(settings) == 1:  # known to change nothing with others
            check_loop(changed, loop, trials, runs)
        return judged(self.model, self.baseline, runs)

    def _timed(self, changed: mujoco.MjModel, loop: LoopChange) -> LaunchRow:
        path, trials = paths.find(loop.path), self.baseline.trials
        hold = trajectories.steps_per_control(self.model, trials.control_s)
        run_s = BLOCK_NCONTROL * hold * self._step_s
        nrun = int(np.clip(BLOCK_S / run_s, min(LEAST_NRUN, trials.nrun), trials.nrun))
        ncontrol = 1 if run_s > BLOCK_S else min(BLOCK_NCONTROL, trials.ncontrol)
        rng = np.random.default_rng(self.request.seed)
        drawn = trials.only(rng.choice(trials.nrun, nrun, replace=False)).first(ncontrol)
        present = prepared(self.model, drawn, path, {})
        other = prepared(changed, drawn, path, loop.options)
        warm_s = sum(timing.block_s(timing.Contender(each.run)) for each in (present, other))
        quads = int(np.clip(self.request.timed_s / (2 * warm_s), LEAST_QUADS, MOST_QUADS))
        orders = timing.draw_orders(quads)
        seconds = timing.block_times(present.run, other.run, orders)
        return LaunchRow(None, None, orders, [[round(1e9 * s) for s in quad] for quad in seconds])


def step_stages(model: mujoco.MjModel, trials: Trials) -> StepStages:
    hold = trajectories.steps_per_control(model, trials.control_s)
    trials = trajectories.fitted(model, trials)
    run_s = hold * reference_run.step_s(model, trials.initial_state[0])
    nrun = max(1, int(BLOCK_S / run_s))
    block = profile.Block(nrun, hold, lambda: StartsInTurn(model, trials.initial_state))
    timers = profile.timer_shares(model, block)
    return step_parts.stages(model, timers, block.new_start, STAGES_S)


def judged(model: mujoco.MjModel, baseline: Baseline, runs: Trajectories) -> Accuracy:
    """Return what settings do to the motion, and to sensor data where that stays the same."""
    ncontrol, scale = baseline.facts.horizon_ncontrol, baseline.motion
    within, present = runs.first(ncontrol), baseline.present.first(ncontrol)
    effect, sensors = _effect(model, baseline, runs), SensorChange(0, 0.0)
    if effect != Effect.APPROXIMATE and not runs.has_sensors_of(baseline.present):
        effect = Effect.EQUIVALENT
        sensors = trajectories.sensor_change(model, runs, baseline.present)
    error, run_errors = None, list[float]()
    if baseline.reference is not None:
        error = accuracy.distance(model, scale, within, baseline.reference)
        run_errors = accuracy.shares(model, scale, within, baseline.reference).tolist()
    effect = Effect.APPROXIMATE if sensors.changed else effect
    apart = accuracy.distance(model, scale, within, present)
    return Accuracy(effect, error, apart, run_errors, sensors.changed, sensors.share)


def _effect(model: mujoco.MjModel, baseline: Baseline, runs: Trajectories) -> Effect:
    if runs.is_identical(baseline.present):
        return Effect.FREE
    ncontrol = baseline.same_ncontrol
    if ncontrol < min(LEAST_NCONTROL, baseline.trials.ncontrol):
        return Effect.APPROXIMATE  # rounding alone makes as much
    over_time = accuracy.bounds_over_time(
        model, baseline.motion, runs.first(ncontrol), baseline.present.first(ncontrol)
    )
    return Effect.EQUIVALENT if np.all(over_time <= SAME_SHARE) else Effect.APPROXIMATE


def check_loop(model: mujoco.MjModel, loop: LoopChange, trials: Trials, runs: Trajectories) -> None:
    of_loop = prepared(model, trials, paths.find(loop.path), loop.options)
    if not np.array_equal(of_loop.verified_states().values, runs.points[:, -1]):
        raise InputError("the loop reaches other final states with it")


def prepared(
    model: mujoco.MjModel,
    trials: Trials,
    path: paths.SteppingPath,
    options: Mapping[str, str | int],
) -> paths.Prepared:
    hold = trajectories.steps_per_control(model, trials.control_s)
    trials = trajectories.fitted(model, trials)
    drawn = Workload(model, trials.initial_state.copy(), trials.control.copy(), hold, 0)
    reason = path.cannot_run(drawn, options)
    if reason:
        raise InputError(reason)
    return path.prepare(drawn, path.complete(options), paths.Resources(drawn))
