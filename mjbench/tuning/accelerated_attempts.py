"""Try settings of MJX or Warp in a child process, each beside the present ones.

One process compiles the present settings once and then one setting after the other. Both programs
are timed in alternating blocks, so that the machine's drift affects them alike. A setting whose
program crashes or never returns ends the process: the parent starts another one after it.
"""

import copy
import dataclasses
import math
import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench.comparison.accelerated_measurement import CHILD_MEMORY_SHARE, COMPILER_PATIENCE
from mjbench.errors import MachineError, UnavailableError, describe
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.paired.records import LaunchRow
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths.accelerated import AcceleratedPath, Compiled, accelerated_path, start_fields
from mjbench.paths.warp_buffers import OverflowedError
from mjbench.simulation import model_options, models, reference_run, workload
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.tuning import accuracy, knob_values, measurements, reference, trajectories
from mjbench.tuning.accuracy import Distance, Motion
from mjbench.tuning.records import Attempt, BatchFacts, TunedProgram, log_ratio
from mjbench.tuning.reference import LEAST_NCONTROL, TrialPlan
from mjbench.tuning.setting_launch import launch, try_each
from mjbench.tuning.settings import Settings, buffer_sizes_of, edits_of
from mjbench.tuning.trajectories import Trajectories, Trials

# Controls of a timed block.
BLOCK_NCONTROL = 4
# Seconds of timing that a setting gets, and quads at least and at most.
TIMED_S, MIN_QUADS, MAX_QUADS = 4.0, 4, 25


@dataclass(frozen=True)
class EngineCase:
    """An engine, a model, the file of C's `EngineBaseline`, and the limit of silence."""

    source: ModelSource
    engine: str
    nbatch: int
    file: Path
    limit_s: float


@dataclass(frozen=True, eq=False)
class EngineBaseline:
    """C's runs with the present settings, and what an engine needs to repeat them.

    Attributes:
      default_sizes: of the engine's buffers (see `AcceleratedPath.default_buffer_sizes`).
    """

    trials: Trials
    runs: Trajectories
    motion: Motion
    peaks: Peaks
    default_sizes: dict[str, int]


class EngineMeasurements:
    """Measures an engine on one model on this machine; its files last as long as the pool."""

    def __init__(
        self, pool: WorkerPool, source: ModelSource, engine: str, nbatch: int, limit_s: float
    ):
        resolved = ModelSource(source.name, source.path.resolve())
        self._case = EngineCase(resolved, engine, nbatch, pool.new_file(".pickle"), limit_s)
        self._environment = accelerated_path(engine).environment()

    def baseline(self, plan: TrialPlan) -> BatchFacts:
        """Draw trials and run C; launches use them from then on."""
        limit_s = max(measurements.RUNS_SILENCE_S, self._case.limit_s)
        facts: BatchFacts = isolate.call(
            run_baseline, self._case, plan, limit_s=limit_s, **self._child()
        )
        return facts

    def launch(
        self,
        settings: Sequence[Settings],
        on_attempt: Callable[[Attempt], None],
        stop_after_s: float = math.inf,
        has_errors: bool = True,
    ) -> TunedProgram:
        """Try settings in a fresh process, errors only if asked for; return the present program."""
        programs: list[TunedProgram] = []

        def receive(message: TunedProgram | Attempt) -> None:
            if isinstance(message, TunedProgram):
                programs.append(message)
            else:
                on_attempt(message)

        launch(
            run_launch,
            lambda left, left_s: (self._case, left, has_errors, left_s),
            settings,
            stop_after_s,
            receive,
            self._case.limit_s,
            **self._child(),
        )
        return programs[0]

    def _child(self) -> dict[str, Any]:
        memory_bytes = int(CHILD_MEMORY_SHARE * machine.available_memory_bytes())
        return {"environment": self._environment, "memory_bytes": memory_bytes}


# -- in the child --------------------------------------------------------------------------------


def run_baseline(case: EngineCase, plan: TrialPlan, channel: Channel) -> BatchFacts:
    path = accelerated_path(case.engine)
    channel.doing(f"loading {case.source.name}")
    model = models.load(case.source)
    channel.doing(f"running {case.source.name} with its present settings")
    full = reference.baseline(model, plan)
    rounded = trajectories.run(model, _rounded(full.trials, path))
    # for as many controls, errors mean something in C and in the engine's precision
    apart = accuracy.shares_over_time(model, full.motion, rounded, full.present)
    of_engine = max(LEAST_NCONTROL, reference.horizon(apart, np.zeros_like(apart)))
    ncontrol = min(full.facts.horizon_ncontrol, of_engine)
    trials, runs = full.trials.first(ncontrol), full.present.first(ncontrol)
    repeated = _batch(model, trials, trials.nrun, trials.ncontrol)
    reason = path.cannot_run(repeated, {})
    if reason:
        raise UnavailableError(reason)
    starts_qpos = workload.fields(model, trials.initial_state)["qpos"]
    sizes = path.default_buffer_sizes(model)
    baseline = EngineBaseline(
        trials,
        runs,
        accuracy.motion(model, starts_qpos, runs),
        reference_run.observe(repeated).peaks,
        sizes,
    )
    case.file.write_bytes(pickle.dumps(baseline))
    return BatchFacts(
        path.device_kind(),
        path.precision,
        trials.nrun,
        ncontrol * trials.control_s,
        ncontrol,
        full.facts.starts,
        _error(model, baseline, rounded.first(ncontrol)),
        knob_values.of_batched_step(model, baseline.peaks, sizes),
    )


def run_launch(
    case: EngineCase,
    settings: Sequence[Settings],
    has_errors: bool,
    stop_after_s: float,
    channel: Channel,
) -> None:
    """Send the `TunedProgram` of the present settings, then an `Attempt` for each setting."""
    end_s = time.perf_counter() + stop_after_s
    model = models.load(case.source)
    baseline: EngineBaseline = pickle.loads(case.file.read_bytes())
    path = accelerated_path(case.engine)
    trying = _Launch(case, has_errors, model, baseline, path, channel)
    channel.doing("compiling the present settings")
    try:
        present, program, sizes = trying.present()
    except (NotImplementedError, TypeError, ValueError) as error:  # engines trace, then reject
        reason = f"{path.engine} does not take this model: {describe(error)}"
        raise UnavailableError(reason) from error
    channel.send(program)

    def attempt(tried: Settings) -> Attempt:
        return trying.attempt(tried, present, sizes)

    # engines reject settings with exceptions of any type
    try_each(settings, end_s, channel, attempt, (Exception,))


@dataclass(frozen=True)
class _Launch:
    case: EngineCase
    has_errors: bool
    model: mujoco.MjModel
    baseline: EngineBaseline
    path: AcceleratedPath
    channel: Channel

    def present(self) -> tuple[Compiled, TunedProgram, Mapping[str, int]]:
        """Return the program of the present settings, and the buffer sizes that it asks for."""
        sizes = self.baseline.default_sizes
        try:
            return *self._compiled((), sizes), sizes
        except OverflowedError:
            return *self._compiled((), {}), {}

    def attempt(self, settings: Settings, present: Compiled, sizes: Mapping[str, int]) -> Attempt:
        compiled, program = self._compiled(settings, {**sizes, **buffer_sizes_of(settings)})
        samples = _timed(present, compiled, self.channel, self.case.limit_s)
        compiled.verified_states()  # fails where a buffer is too small for the timed run
        ratio = math.exp(log_ratio(samples))
        return Attempt(settings, Status.OK, time_ratio=ratio, program=program, samples=samples)

    def _compiled(
        self, settings: Settings, sizes: Mapping[str, int]
    ) -> tuple[Compiled, TunedProgram]:
        trials, limit_s = self.baseline.trials, self.case.limit_s
        changed = copy.copy(self.model)
        for edit in edits_of(settings):
            model_options.set_option(changed, edit.name, edit.value)
        ncontrol = min(BLOCK_NCONTROL, trials.ncontrol)
        block = _batch(changed, trials, self.case.nbatch, ncontrol)
        self.channel.allow_silence(COMPILER_PATIENCE * limit_s)
        compiled = self.path.compile(block, sizes, self.baseline.peaks)
        error = None
        if self.has_errors:
            runs = _runs(compiled, block, trials, self.channel, limit_s)
            error = _error(self.model, self.baseline, runs)
        program = TunedProgram(
            error, compiled.trace_s, compiled.compile_s, dict(compiled.buffer_sizes)
        )
        return compiled, program


def _rounded(trials: Trials, path: AcceleratedPath) -> Trials:
    return dataclasses.replace(
        trials,
        initial_state=trials.initial_state.astype(path.precision).astype(float),
        control=trials.control.astype(path.precision).astype(float),
    )


def _batch(model: mujoco.MjModel, trials: Trials, nbatch: int, ncontrol: int) -> Workload:
    """Return a batch with the trials' starts; where they repeat, with other controls."""
    i = np.arange(nbatch)
    starts = trials.initial_state[i % trials.nrun]
    control = trials.control[(i + i // trials.nrun) % trials.nrun, :ncontrol]
    hold = trajectories.steps_per_control(model, trials.control_s)
    return Workload(model, starts, np.ascontiguousarray(control), hold, 0)


def _runs(
    compiled: Compiled, block: Workload, trials: Trials, channel: Channel, limit_s: float
) -> Trajectories:
    model, nrun = block.model, trials.nrun
    qpos = np.empty((nrun, trials.ncontrol, model.nq))
    qvel = np.empty((nrun, trials.ncontrol, model.nv))
    for begin in range(0, nrun, block.nbatch):
        rows = np.arange(begin, min(begin + block.nbatch, nrun))
        filled = np.arange(begin, begin + block.nbatch) % nrun  # the program has a fixed size
        starts = dataclasses.replace(block, initial_state=trials.initial_state[filled])
        fields = start_fields(starts)
        for k in range(trials.ncontrol):
            control = np.zeros_like(block.control)
            control[:, 0] = trials.control[filled, k]
            channel.allow_silence(limit_s)
            after = dict(compiled.advance(fields, control, block.hold).fields)
            after.pop("ctrl", None)
            fields |= after
            qpos[rows, k] = fields["qpos"][: len(rows)]
            qvel[rows, k] = fields["qvel"][: len(rows)]
    is_finite = np.isfinite(qpos).all(axis=(1, 2)) & np.isfinite(qvel).all(axis=(1, 2))
    lost = np.asarray(~is_finite)
    if lost.any():
        raise MachineError(f"diverges in {int(lost.sum())} of {nrun} runs")
    nothing = np.empty((nrun, 0, 0))
    return Trajectories(qpos, qvel, nothing, nothing, lost)


def _error(model: mujoco.MjModel, baseline: EngineBaseline, runs: Trajectories) -> Distance:
    return accuracy.distance(model, baseline.motion, runs, baseline.runs)


def _timed(present: Compiled, other: Compiled, channel: Channel, limit_s: float) -> LaunchRow:
    def clear() -> None:
        present.clear()
        other.clear()

    channel.allow_silence(2 * limit_s)
    warm_s = [timing.block_s(timing.Contender(each.run, clear)) for each in (present, other)]
    quads = int(np.clip(TIMED_S / (2 * sum(warm_s)), MIN_QUADS, MAX_QUADS))
    orders, seconds = timing.draw_orders(quads), []
    for order in orders:
        channel.allow_silence(4 * limit_s)
        seconds += timing.block_times(present.run, other.run, [order], before=clear)
    return LaunchRow(None, None, orders, [[round(1e9 * s) for s in quad] for quad in seconds])
