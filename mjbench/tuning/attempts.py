"""Try settings in a child process: what they do to the states, and about how fast they are.

A setting may crash MuJoCo or never return, so each attempt has a process of its own. Its time is
measured within that process, which is good for choosing what to look at again, and for no more.
"""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench import paths
from mjbench.errors import InputError, MachineError
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.measuring import stats, timing
from mjbench.simulation import work
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.tuning import distance, reference, trajectories, variants
from mjbench.tuning.physics import physics
from mjbench.tuning.records import Accuracy, Attempt, Effect
from mjbench.tuning.reference import Baseline, Present, TrialPlan
from mjbench.tuning.settings import NO_CHANGE, LoopChange, Setting, edits_of, loop_change
from mjbench.tuning.trajectories import Trajectories, Trials

# Seconds of a block that an attempt times, and quads of such blocks.
BLOCK_S, QUADS = 0.002, 25
# Controls of each run in such a block.
BLOCK_NCONTROL = 2
# Seconds of silence after which a child is killed.
SILENCE_S = 120.0
# Seconds that the reference may take.
BASELINE_SILENCE_S = 600.0


@dataclass(frozen=True)
class BaselineRequest:
    """Asks a child for the present settings' runs, and for the reference."""

    source: ModelSource
    plan: TrialPlan
    file: Path
    model_file: Path


@dataclass(frozen=True)
class AttemptRequest:
    """Asks a child to try settings.

    Attributes:
      model_file: to save the changed model to; None to save none.
      nrun: runs of the trials to do, the first ones; None for all.
      quads: blocks to time, as quads; 0 to measure no time.
    """

    source: ModelSource
    baseline_file: Path
    settings: tuple[Setting, ...]
    model_file: Path | None = None
    nrun: int | None = None
    quads: int = QUADS


def measure_baseline(request: BaselineRequest, limit_s: float = SILENCE_S) -> Present:
    """Return what the present settings do; their runs are in the request's file."""
    messages: list[Present] = []
    task = "mjbench.tuning.attempts:run_baseline"
    isolate.run(task, request, messages.append, limit_s).check()
    return messages[0]


def attempt(request: AttemptRequest, limit_s: float = SILENCE_S) -> Attempt:
    """Return how settings did; a crash, a hang or a divergence is a status."""
    messages: list[Attempt] = []
    task = "mjbench.tuning.attempts:run_attempt"
    ended = isolate.run(task, request, messages.append, limit_s)
    return messages[0] if messages else Attempt(request.settings, ended.status, ended.detail)


def run_baseline(request: BaselineRequest, channel: Channel) -> None:
    """Run the present settings and the reference; runs in a child."""
    channel.doing(f"running {request.source.name} with its present settings")
    channel.allow_silence(BASELINE_SILENCE_S)  # the reference has many steps
    model = variants.compiled(request.source, ())
    baseline = reference.baseline(model, request.plan)
    with request.file.open("wb") as stream:
        pickle.dump(baseline, stream)
    save(model, request.model_file)
    channel.send(baseline.facts)


def run_attempt(request: AttemptRequest, channel: Channel) -> None:
    """Try settings; runs in a child."""
    channel.doing("applying the settings")
    baseline: Baseline = pickle.loads(request.baseline_file.read_bytes())
    if request.nrun is not None:
        baseline = baseline.only(request.nrun)
    model = variants.compiled(request.source, ())
    changed = variants.compiled(request.source, edits_of(request.settings))
    channel.doing("running the model")
    runs = trajectories.run(changed, baseline.trials)
    if runs.diverged.any():
        raise InputError(f"diverges in {int(runs.diverged.sum())} of {len(runs.diverged)} runs")
    accuracy = judged(model, baseline, runs)
    if request.model_file is not None:
        save(changed, request.model_file)
    loop = loop_change(request.settings)
    if loop != NO_CHANGE and len(request.settings) == 1:  # known to change nothing with others
        _check_loop(changed, loop, baseline.trials, runs)
    channel.doing("timing the model")
    ratio = None
    if request.quads:
        ratio = _time_ratio(model, changed, loop, baseline, request.quads)
    channel.send(Attempt(request.settings, Status.OK, "", accuracy, ratio))


def judged(model: mujoco.MjModel, baseline: Baseline, runs: Trajectories) -> Accuracy:
    """Return what settings do to the motion."""
    ncontrol, scale = baseline.facts.horizon_ncontrol, baseline.motion
    within, present = (
        runs.first(ncontrol),
        baseline.present.first(ncontrol),
    )
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


def save(model: mujoco.MjModel, file: Path) -> None:
    """Save a compiled model."""
    mujoco.mj_saveModel(model, str(file), None)
    if not file.exists() or file.stat().st_size < mujoco.mj_sizeModel(model):
        raise MachineError(f"cannot write {file}: is the disk full?")


def _time_ratio(
    model: mujoco.MjModel,
    changed: mujoco.MjModel,
    loop: LoopChange,
    baseline: Baseline,
    quads: int,
) -> float:
    """Return the time of a simulated second with other settings over that with present ones.

    Both do the same number of steps from the same states under the same controls.
    """
    trials, path = baseline.trials, paths.find(loop.path)
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
    reason = path.unavailable() or path.unsuited(drawn, options)
    if reason:
        raise InputError(reason)
    return path.prepare(drawn, path.complete(options), paths.Resources(drawn))
