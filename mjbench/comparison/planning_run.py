"""Run a planner in a closed loop, its candidates rolled out by several paths in turns.

At each control, every path rolls out the same candidates from the same state. What it returns must
be bit-identical to what the plain loop returns, so all paths give the same plan; its time is that
of one plan. The loop then goes on with that plan. Runs in a child process (see `isolate`).
"""

import dataclasses
import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from mjbench import paths
from mjbench.bounds import PositiveFloat, PositiveInt
from mjbench.comparison.plan import Variant
from mjbench.comparison.sampling_planners import (
    Algorithm,
    Planner,
    PlannerSettings,
    PlannerStates,
    task_of,
)
from mjbench.errors import InputError, describe, one_line
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.limits import TIME_LIMIT_S
from mjbench.loop.loop_starts import LoopStarts
from mjbench.simulation import agreement, compat, models
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan, Starts
from mjbench.simulation.workload import Product, Workload
from mjbench.status import Status

# Seconds of a loop; plans to make even where they take longer.
BUDGET_S, LEAST_NPLAN = 60.0, 4


@dataclass(frozen=True)
class PlanningRequest:
    """A planner to run.

    Attributes:
      variants: paths that roll out, the base path first.
      hold: steps for which each control is held, in the plan and in the loop.
      budget_s: seconds after which no plan begins, once there are a few.
      states_file: with the states to plan from, one a plan; None to plan from where the loop is.
    """

    source: ModelSource
    variants: tuple[Variant, ...]
    settings: PlannerSettings
    hold: int
    duration_s: float
    states_file: Path | None = None
    budget_s: float = BUDGET_S


@dataclass(frozen=True, kw_only=True)
class PlanningRow:
    """A path's plans, as people and programs read them; None is what was not measured.

    Attributes:
      samples: candidates of a plan.
      horizon: steps of each.
      status: `ok`, or why its plans do not count.
      plan_s: seconds of a plan, the median.
      plans_per_s: its inverse.
      speedup: over the plain loop, plan by plan: the median.
      control_hz: controls per simulated second, which plans in real time must keep up with.
      achieved: whether the loop achieved the task; None also where each plan starts from another
        state, and where the budget ended the loop.
      state_digest: names all states of the loop, bit by bit.
      starts: where the states to plan from came from; None for the loop itself.
    """

    record_type: ClassVar[str] = "plan"
    model: str
    task: str | None = None
    algorithm: Algorithm
    samples: PositiveInt
    horizon: PositiveInt
    path: str
    options: Mapping[str, Any]
    status: Status = Status.OK
    detail: str = ""
    nplan: PositiveInt | None = None
    plan_s: PositiveFloat | None = None
    plans_per_s: PositiveFloat | None = None
    speedup: PositiveFloat | None = None
    control_hz: PositiveFloat | None = None
    achieved: bool | None = None
    state_digest: str | None = None
    starts: Starts | None = None


def stored(request: PlanningRequest, records: Sequence[object]) -> list[PlanningRow]:
    """Return the rows of a request from records of a run; none unless all are there."""
    size = request.source.name, request.settings.samples, request.settings.knots * request.hold
    rows = [
        row
        for row in records
        if isinstance(row, PlanningRow) and (row.model, row.samples, row.horizon) == size
    ]
    return rows if len(rows) == len(request.variants) else []


def run(
    request: PlanningRequest, import_from: str | None = None, limit_s: float = TIME_LIMIT_S
) -> list[PlanningRow]:
    """Run a planner in a child, and return a row for each variant; MjbenchError if it fails."""
    return isolate.call(plan_in_child, request, limit_s=limit_s, import_from=import_from)


def plan_in_child(request: PlanningRequest, channel: Channel) -> list[PlanningRow]:
    channel.doing("loading the model")
    model = models.load(request.source)
    if not model.nu:
        raise InputError(f"{request.source.name} has no controls to plan")
    channel.doing("preparing paths")
    planned = [_PlannedPath(variant, model, request) for variant in request.variants]
    channel.doing("planning")
    of_loop = _Loop(model, request, planned).run(channel)
    for path in planned:
        path.close()
    return [path.row(of_loop, planned[0]) for path in planned]


class _PlannedPath:
    def __init__(self, variant: Variant, model: mujoco.MjModel, request: PlanningRequest):
        samples, knots = request.settings.samples, request.settings.knots
        nstate = compat.state_size(model)
        self._variant = variant
        states, control = np.zeros((samples, nstate)), np.zeros((samples, knots, model.nu))
        seed, returns = request.settings.seed, Product.TRAJECTORY
        self._workload = Workload(model, states, control, request.hold, seed, returns)
        self._resources = paths.Resources(self._workload)
        self._prepared: paths.Prepared | None = None
        self.plan_s: list[float] = []
        self.status, self.detail = Status.OK, ""

    def roll_out(
        self, start: np.ndarray, candidates: np.ndarray, cost: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return (samples, nstep, nphysics) states and (samples,) costs; None if the path fails."""
        try:
            workload = self._workload
            if self._prepared is None:
                self._prepare(start, candidates)
                if self._prepared is None:
                    return None
            self._prepared.clear()
            assert self._prepared.step_outputs is not None, "it returns trajectories"
            begin = time.perf_counter()
            workload.initial_state[:] = start
            workload.control[:] = candidates
            self._resources.changed()
            self._prepared.run()
            states = self._prepared.step_outputs().state
            assert states is not None, "it returns trajectories"
            costs = cost(states)
            self.plan_s.append(time.perf_counter() - begin)
        except BaseException as error:  # a path's own failure costs its own row
            self.fail(Status.FAILED, describe(error))
            return None
        return states, costs

    def _prepare(self, start: np.ndarray, candidates: np.ndarray) -> None:
        self._workload.initial_state[:] = start
        self._workload.control[:] = candidates
        path = paths.find(self._variant.path)
        if reason := path.cannot_run(self._workload, self._variant.options):
            self.fail(Status.UNAVAILABLE, one_line(reason))
            return
        self._prepared = path.prepare(self._workload, self._variant.options, self._resources)
        self._prepared.run()

    def fail(self, status: Status, detail: str) -> None:
        self.status, self.detail = status, detail

    def row(self, of_loop: PlanningRow, base: "_PlannedPath") -> PlanningRow:
        row = dataclasses.replace(
            of_loop,
            path=self._variant.path,
            options=self._variant.options,
            status=self.status,
            detail=self.detail,
        )
        if self.status != Status.OK:
            return row
        plan_s = statistics.median(self.plan_s)
        speedup = statistics.median(
            before / own for before, own in zip(base.plan_s, self.plan_s, strict=True)
        )
        return dataclasses.replace(row, plan_s=plan_s, plans_per_s=1 / plan_s, speedup=speedup)

    def close(self) -> None:
        self._resources.close()


class _Loop:
    def __init__(
        self, model: mujoco.MjModel, request: PlanningRequest, planned: Sequence[_PlannedPath]
    ):
        self._model, self._request, self._planned = model, request, planned
        self._task = task_of(request.source.name, model)
        # looked up here, and not in each plan, which is timed
        self._guard = ModelGuard(model)
        self._columns = compat.state_columns(model, compat.FULLPHYSICS)

    def run(self, channel: Channel) -> PlanningRow:
        """Plan and step until the duration or the budget is over; return what paths share."""
        model, request, task = self._model, self._request, self._task
        data = task.start(model)
        low, high = _control_range(model)
        planner = Planner(request.settings, np.array(data.ctrl), low, high)
        control_s = request.hold * float(model.opt.timestep)
        nplan = max(LEAST_NPLAN, round(request.duration_s / control_s))
        given = None
        if request.states_file is not None:
            plan = StartPlan(file=request.states_file)
            given = LoopStarts(model, plan, request.hold, request.settings.seed)
        in_turn = None if given is None else given.in_turn()
        start = np.empty(compat.state_size(model))
        states = np.empty((nplan, compat.state_size(model, compat.FULLPHYSICS)))
        shuffle = random.Random(request.settings.seed).shuffle
        end_s, is_cut_short = time.monotonic() + request.budget_s, False
        for k in range(nplan):
            if k >= LEAST_NPLAN and time.monotonic() > end_s:
                states, is_cut_short = states[:k], True
                break
            channel.allow_silence(0.0)  # a sign of life: no plan may take longer than the limit
            if in_turn is not None:
                in_turn(model, data)
            compat.get_state(model, data, start)
            candidates = planner.candidates()
            planner.improve(candidates, self._costs(start, candidates, shuffle))
            data.ctrl[:] = planner.advance()
            mujoco.mj_step(model, data, request.hold)
            compat.get_state(model, data, states[k], compat.FULLPHYSICS)
        nplan = len(states)
        last = PlannerStates.of(self._columns, states[-(nplan // 4) :])
        is_judged = given is None and not is_cut_short
        settings = request.settings
        return PlanningRow(
            model=request.source.name,
            task=task.name,
            algorithm=settings.algorithm,
            samples=settings.samples,
            horizon=settings.knots * request.hold,
            path=paths.BASE,
            options={},
            nplan=nplan,
            control_hz=1 / control_s,
            achieved=task.is_achieved(last) if is_judged else None,
            state_digest=agreement.digest(states),
            starts=None if given is None else given.starts,
        )

    def _costs(
        self, start: np.ndarray, candidates: np.ndarray, shuffle: Callable[[list[int]], None]
    ) -> np.ndarray:
        """Return the (samples,) costs of candidates, which every path has rolled out in turn."""

        def cost(physics: np.ndarray) -> np.ndarray:
            return self._task.cost(PlannerStates.of(self._columns, physics), candidates)

        order = [i for i, path in enumerate(self._planned) if path.status == Status.OK]
        shuffle(order)
        digests: dict[int, str] = {}
        base: tuple[np.ndarray, np.ndarray] | None = None
        for i in order:
            rolled_out = self._planned[i].roll_out(start, candidates, cost)
            self._guard.check(f"{self._request.variants[i]} ")
            if rolled_out is not None:
                digests[i] = agreement.digest(rolled_out[0])
            if i == 0 and rolled_out is not None:
                base = rolled_out[0].copy(), rolled_out[1]
        if base is None:
            raise InputError(f"the plain loop fails: {self._planned[0].detail}")
        for i, digest in digests.items():
            if digest != digests[0]:
                again = self._planned[i].roll_out(start, candidates, cost)
                if again is not None:
                    where = agreement.first_differing_step(again[0], base[0], self._columns)
                    detail = str(where or "its states differ from run to run")
                    self._planned[i].fail(Status.DISAGREES, detail)
        return base[1]


def _control_range(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return (nu,) smallest and largest controls; those without a range are within 1 of 0."""
    limited = np.asarray(model.actuator_ctrllimited, dtype=bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], 1.0)
    return low, high
