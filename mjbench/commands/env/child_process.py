"""Measure one environment, in a child process (see `isolate`).

The order is: make it, record its steps twice and check its physics, verify the other paths of the
same physics, and only then time: plain passes, layered passes and the paths, in turns of random
order.
"""

import functools
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.commands.env import adapters, construction, physics_comparison, timer
from mjbench.commands.env.adapters import EnvironmentAdapter
from mjbench.commands.env.passes import EnvironmentPasses, Pass, in_random_order, time_rounds
from mjbench.commands.env.physics_comparison import PhysicsAlone, PhysicsComparison
from mjbench.commands.env.recording import EngineWatch, Recording, StepTrace
from mjbench.commands.env.repetition import FieldDifference, left_by_reset, physics_differences
from mjbench.commands.env.result import (
    EnvironmentFacts,
    EnvironmentRecord,
    PathSamples,
    PhysicsCheck,
)
from mjbench.commands.env.source import EnvironmentSource
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.paths.base import nthread
from mjbench.simulation import engine_functions, reference_run
from mjbench.status import Status
from mjbench.verification.path_verification import AgreementReport
from mjbench.verification.plan import Variant

# Steps that show how long one takes: a few, then more if these would take less than a second.
_FIRST_NSTEP, _WARM_UP_NSTEP, _WARM_UP_S = 5, 50, 1.0
# Steps of a pass unless the user says: as many as take this share of the time, and no longer than
# this, within these bounds.
PASS_SHARE, PASS_S, LEAST_NSTEP, MOST_NSTEP = 0.005, 0.1, 50, 1000
# Seconds between two messages that allow the child further silence.
_HEARTBEAT_S = 1.0


@dataclass(frozen=True)
class EnvironmentPlan:
    """What is measured of an environment.

    Attributes:
      nstep: steps of it in a pass; None to choose them.
      nenv: numbers of environments in vectorised forms; none for no such forms.
      budget_s: seconds for all, of which rounds of the environment leave half to vectorised forms.
      limit_s: a child that is silent for longer is killed.
      must_end: whether it ends then even without an interval.
    """

    nstep: int | None
    seed: int
    threads: tuple[int, ...]
    nenv: tuple[int, ...]
    budget_s: float
    limit_s: float
    must_end: bool = False


@dataclass(frozen=True)
class EnvironmentRequest:
    """An environment to measure, and the paths to compare it with, the plain loop first."""

    source: EnvironmentSource
    plan: EnvironmentPlan
    variants: tuple[Variant, ...]

    @property
    def most_threads(self) -> int:
        return max((nthread(variant.options) for variant in self.variants), default=1)


def measure_in_child(request: EnvironmentRequest, channel: Channel) -> None:
    """Measure one environment; each message is its record so far, an `EnvironmentRecord`."""
    begin_s = time.monotonic()
    channel.doing("making the environment")
    adapter = adapters.adapt(construction.make(request.source))
    channel.doing("stepping the environment")
    heartbeat = _heartbeat(channel)
    seed = request.plan.seed
    pass_s = min(PASS_S, PASS_SHARE * request.plan.budget_s)
    nstep = request.plan.nstep or _affordable_nstep(adapter, seed, pass_s, heartbeat)
    passes = EnvironmentPasses(adapter, _actions(adapter, nstep, seed), seed)
    channel.doing("recording the steps of the environment")
    times, recording = _recorded(passes, heartbeat)
    _check_steps_engine(recording, nstep)
    again, recording_again = _recorded(passes, heartbeat)
    unrepeated = [
        *times.returned.differences(again.returned),
        *physics_differences(recording, recording_again),
    ]
    physics = _physics_alone(recording, unrepeated, seed, request.most_threads)
    record = EnvironmentRecord(
        environment=request.source.name,
        facts=replace(
            _facts(adapter, recording, times, seed, unrepeated),
            left_by_reset=left_by_reset(recording, recording_again),
        ),
        check=_check(recording, physics),
        changes=recording.changes,
        timer_cost=timer.measure_cost(),
    )
    progress = _Progress(record, channel)
    comparison = None
    if isinstance(physics, PhysicsAlone):
        comparison = physics_comparison.prepare(
            physics, request.variants, progress.add_path, channel
        )
    turns = _Turns(passes, comparison, request, progress)
    share = 0.5 if request.plan.nenv else 1.0
    left_s = share * request.plan.budget_s - (time.monotonic() - begin_s)
    time_rounds(turns.round, progress.send, left_s, channel)
    if comparison is not None:
        record = progress.record
        wrong = {
            i: replace(
                record.paths[i],
                status=Status.DISAGREES,
                detail=f"in a timed block: {difference}",
                ns=(),
            )
            for i, difference in comparison.differences.items()
        }
        progress.send(
            replace(record, paths=[wrong.get(i, path) for i, path in enumerate(record.paths)])
        )
        comparison.close()


class _Progress:
    def __init__(self, record: EnvironmentRecord, channel: Channel):
        self.channel = channel
        self.send(record)

    def send(self, record: EnvironmentRecord) -> None:
        self.record = record
        self.channel.send(record)

    def add_path(self, variant: Variant, report: AgreementReport) -> None:
        path = PathSamples(
            path=variant.path,
            options=variant.options,
            closed_loop=paths.find(variant.path).closed_loop,
            status=report.status,
            detail=report.detail,
        )
        self.send(replace(self.record, paths=[*self.record.paths, path]))


def _recorded(passes: EnvironmentPasses, heartbeat: Callable[[], None]) -> tuple[Pass, Recording]:
    watch = EngineWatch()
    return passes.recorded(watch, heartbeat), watch.recording()


def _heartbeat(channel: Channel) -> Callable[[], None]:
    """Return a function that allows the child further silence, at most once a second."""
    last = time.monotonic()

    def beat() -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > _HEARTBEAT_S:
            last = now
            channel.allow_silence(0.0)

    return beat


def _actions(adapter: EnvironmentAdapter, count: int, seed: int) -> list[Any]:
    with construction.as_input_error("its action space"):
        return adapter.draw_actions(count, seed)


def _affordable_nstep(
    adapter: EnvironmentAdapter, seed: int, pass_s: float, heartbeat: Callable[[], None]
) -> int:
    actions = _actions(adapter, _WARM_UP_NSTEP, seed)
    few = EnvironmentPasses(adapter, actions[:_FIRST_NSTEP], seed).plain(heartbeat)
    step_s = float(np.median(few.step_ns)) * 1e-9
    if step_s * _WARM_UP_NSTEP < _WARM_UP_S:
        more = EnvironmentPasses(adapter, actions, seed).plain(heartbeat)
        step_s = float(more.step_ns.mean()) * 1e-9
    return int(min(MOST_NSTEP, max(LEAST_NSTEP, pass_s / max(step_s, 1e-9))))


def _check_steps_engine(recording: Recording, nstep: int) -> None:
    if any(trace is not None for trace in recording.steps):
        return
    if recording.obstacle:
        raise InputError(f"the environment {recording.obstacle}; only mj_step is understood")
    if recording.other_calls:
        raise InputError(
            f"the environment uses MuJoCo but none of its {nstep} steps called mj_step, mj_step1 or"
            " mj_step2 from Python"
        )
    raise InputError(f"no MuJoCo physics: none of its {nstep} steps called the engine from Python")


def _physics_alone(
    recording: Recording, unrepeated: Sequence[FieldDifference], seed: int, nthread: int
) -> PhysicsAlone | str:
    """Return the physics to compare with; or why there is no comparison, in one line."""
    if any(difference.is_physics for difference in unrepeated):
        return "with the same seed and actions, its physics is not the same again"
    physics = physics_comparison.physics_of(recording, seed, nthread)
    if isinstance(physics, str):
        return physics
    if not np.isfinite(physics.final_state).all():
        return "its states are not finite"
    return physics_comparison.difference_from(physics) or physics


def _check(recording: Recording, physics: PhysicsAlone | str) -> PhysicsCheck:
    if isinstance(physics, PhysicsAlone):
        covered, run, holds = len(physics.numbers), physics.run, physics.holds
        return PhysicsCheck(Status.OK, "", recording.checked, covered, run, holds)
    if recording.difference is not None:
        detail = physics_comparison.described(*recording.difference)
        return PhysicsCheck(Status.DISAGREES, detail, recording.checked)
    return PhysicsCheck(Status.UNAVAILABLE, physics, recording.checked)


def _facts(
    adapter: EnvironmentAdapter,
    recording: Recording,
    times: Pass,
    seed: int,
    unrepeated: Sequence[FieldDifference],
) -> EnvironmentFacts:
    traces = [trace for trace in recording.steps if trace is not None]
    counts = {trace.nstep for trace in traces}
    model = recording.model
    return EnvironmentFacts(
        framework=adapter.framework,
        core=type(adapter.core).__name__,
        wrappers=adapter.wrapper_names,
        versions=adapter.versions(),
        seed=seed,
        nstep=len(recording.steps),
        nepisode=len(times.reset_ns),
        episode_nstep=float(np.mean(times.lengths)) if times.lengths else None,
        repeats=not unrepeated,
        unrepeated=unrepeated,
        dm_control_release=construction.dm_control_mismatch(),
        frame_skip=counts.pop() if len(counts) == 1 else None,
        calls=_calls(traces[0]),
        entered=sorted({name for trace in traces if trace.follows for name in trace.entered}),
        model=None if model is None else reference_run.describe(model),
    )


def _calls(trace: StepTrace) -> list[str]:
    calls: list[str] = []
    for name, nstep in trace.calls:
        calls.append(f"{name}(nstep={nstep})" if name == "mj_step" and nstep != 1 else name)
    period = next(
        (n for n in range(1, len(calls) + 1) if calls == calls[:n] * (len(calls) // n)), 0
    )
    repeats = len(calls) // period if period else 1
    if repeats == 1:
        return calls
    unit = calls[0] if period == 1 else f"({', '.join(calls[:period])})"
    return [f"{repeats} × {unit}"]


class _Turns:
    def __init__(
        self,
        passes: EnvironmentPasses,
        comparison: PhysicsComparison | None,
        request: EnvironmentRequest,
        progress: _Progress,
    ):
        self._passes, self._comparison = passes, comparison
        self._variants, self._progress = request.variants, progress
        self._elsewhere = engine_functions.bindings()
        self._random = random.Random(request.plan.seed)
        self._rng = np.random.default_rng([request.plan.seed, 6])
        cores = min(machine.usable_cores(), request.most_threads)
        self._calibration = machine.Calibration(cores) if cores > 1 and comparison else None

    def round(self) -> EnvironmentRecord:
        """Time both passes and every path once, in random order; return the record with them."""
        comparison, record = self._comparison, self._progress.record
        turns: list[Callable[[], Any]] = [self._both_passes, self._cores]
        if comparison is not None:
            comparison.reorder(self._rng)
            turns += [functools.partial(self._path_ns, comparison, i) for i in comparison.prepared]
        (plain, layered), cores, *path_ns = in_random_order(turns, self._random)
        compared_ns, paths = record.compared_ns, record.paths
        if comparison is not None:
            compared_ns = [*compared_ns, float(plain.step_ns[comparison.physics.numbers].mean())]
            ns = dict(zip(comparison.prepared, path_ns, strict=True))
            paths = [
                replace(path, ns=[*path.ns, ns[i]]) if i in ns else path
                for i, path in enumerate(paths)
            ]
        return replace(
            record,
            step_ns=[*record.step_ns, float(plain.step_ns.mean())],
            compared_ns=compared_ns,
            reset_ns=[*record.reset_ns, float(np.mean(plain.reset_ns))],
            layered_ns=[*record.layered_ns, float(layered.step_ns.mean())],
            timer_ns=[*record.timer_ns, float(np.median(layered.step_ns - plain.step_ns))],
            layers=timer.in_all_rounds([*record.layers, *layered.layers], len(record.step_ns) + 1),
            paths=paths,
            cores=[*record.cores, cores],
        )

    def _both_passes(self) -> tuple[Pass, Pass]:
        self._progress.channel.doing("timing the environment")
        return self._passes.side_by_side(self._elsewhere, self._random)

    def _cores(self) -> float:
        if self._calibration is None:
            return 1.0
        single_s, together_s = (
            timing.block_s(timing.Contender(run))
            for run in (self._calibration.single, self._calibration.together)
        )
        return self._calibration.cores(single_s, together_s)

    def _path_ns(self, comparison: PhysicsComparison, position: int) -> float:
        self._progress.channel.doing(f"timing {self._variants[position]}", position)
        return 1e9 * comparison.block_s(position) / len(comparison.physics.numbers)
