"""Parts of a step: stages by the engine's own timers, and what has none, such as sensors.

A part without a timer is called again and again on states after `mj_forward`. It computes the same
each time: what sensors share, MuJoCo computes once and flags as done, so these flags are cleared
before each call.
"""

import contextlib
import enum
import itertools
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeInt, Share
from mjbench.measuring import timing
from mjbench.simulation import compat

# Seconds for the parts of one kind; rounds, and seconds of a block.
BUDGET_S = 0.5
LEAST_ROUNDS, MOST_ROUNDS, BLOCK_S = 7, 200, 0.0005
# The name of all sensors together, among stages.
SENSORS = "sensors"
# RK4 evaluates the dynamics so often in a step.
_EVALUATIONS_OF_RK4 = 4

# A function of the engine, or what brings an MjData to a start state.
Function = Callable[[mujoco.MjModel, mujoco.MjData], None]

# Stages by MuJoCo's timers (mjtTimer); what they leave of a step is `other`.
STAGES: Mapping[str, str] = {
    "kinematics": "POS_KINEMATICS",
    "inertia": "POS_INERTIA",
    "broad-phase collision": "COL_BROAD",
    "narrow-phase collision": "COL_NARROW",
    "collision": "POS_COLLISION",
    "constraint making": "POS_MAKE",
    "constraint projection": "POS_PROJECT",
    "velocity": "VELOCITY",
    "actuation": "ACTUATION",
    "constraint solver": "CONSTRAINT",
    "integration": "ADVANCE",
}
# What the timers leave of a step.
OTHER = "other"
# The timers that `stage_shares` reads.
TIMERS = (*STAGES.values(), "STEP")


class SensorStage(enum.StrEnum):
    """After which part of a step sensors are computed."""

    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"

    @property
    def need(self) -> mujoco.mjtStage:
        return getattr(mujoco.mjtStage, f"mjSTAGE_{self.value[:3].upper()}")

    @property
    def function(self) -> Function:
        function: Function = getattr(mujoco, f"mj_sensor{self.value[:3].title()}")
        return function


@dataclass(frozen=True)
class SensorCost:
    """What all sensors of a type cost of a step.

    It is their part of what all sensors of their stage take together, in proportion to what each
    type takes alone: what types share is thus counted once.
    """

    type: str
    stage: SensorStage
    count: NonNegativeInt
    share: Share


@dataclass(frozen=True)
class StepPart:
    """A part of a step that is timed apart; its time is a part of that of the stage `within`."""

    name: str
    within: str
    share: float


def with_parts(stages: Mapping[str, float], parts: Sequence[StepPart]) -> dict[str, float]:
    """Return the share of a step by stage, with parts apart from the stages that they are in.

    A stage is never left with less than nothing: where its parts take longer, as they were timed at
    another time, they share what it has.
    """
    apart = dict(stages)
    for stage, share in stages.items():
        inside = [part for part in parts if part.within == stage]
        total = sum(part.share for part in inside)
        scale = min(1.0, share / total) if total > 0 else 0.0
        for part in inside:
            apart[part.name] = apart.get(part.name, 0.0) + scale * part.share
        apart[stage] = max(0.0, share - scale * total)
    return apart


def parts(
    model: mujoco.MjModel,
    start: Function,
    step_s: float,
    sensors: Sequence[SensorCost],
    budget_s: float = BUDGET_S,
) -> list[StepPart]:
    """Return what a step does beside the engine's stages, and tendons."""
    functions = list(_functions(model))
    with _needed_sensors(model) as need_only:
        need_none = need_only(np.zeros(model.nsensor, dtype=bool))
        nothing = need_none, mujoco.mj_sensorVel  # what a call costs by itself
        calls = [(need_none, function) for _, _, _, function in functions]
        of_call_s, *of_parts_s = medians(model, start, [nothing, *calls], budget_s)
    timed = of_sensors(sensors)
    for (name, within, count, _), part_s in zip(functions, of_parts_s, strict=True):
        share = count * max(0.0, part_s - of_call_s) / step_s
        timed.append(StepPart(name, within, share))
    return timed


def of_sensors(sensors: Sequence[SensorCost]) -> list[StepPart]:
    total = sum(each.share for each in sensors)
    return [StepPart(SENSORS, OTHER, total)] if sensors else []


def step_s(model: mujoco.MjModel, start: Function, budget_s: float = BUDGET_S) -> float:
    (seconds,) = medians(model, start, [(lambda: None, mujoco.mj_step)], budget_s)
    return seconds


def _functions(model: mujoco.MjModel) -> Iterator[tuple[str, str, int, Function]]:
    """Yield the name of a part, the stage it is in, how often a step calls it, and its function."""
    is_rk4 = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    evaluations = _EVALUATIONS_OF_RK4 if is_rk4 else 1
    yield "smooth acceleration", OTHER, evaluations, mujoco.mj_fwdAcceleration
    for name in ("Pos", "Vel", "Acc"):
        yield "checks of the state", OTHER, 1, getattr(mujoco, f"mj_check{name}")
    if compat.flag_enabled(model, "energy"):
        for name in ("Pos", "Vel"):
            yield "energy", OTHER, 1, getattr(mujoco, f"mj_energy{name}")
    if model.ntendon:
        yield "tendons", "kinematics", evaluations, mujoco.mj_tendon
    if model.nplugin:
        yield "passive forces with plugins", "velocity", evaluations, mujoco.mj_passive


@contextlib.contextmanager
def _needed_sensors(model: mujoco.MjModel) -> Iterator[Callable[[np.ndarray], Callable[[], None]]]:
    """Yield what makes a preparation of the model in which only some sensors are computed."""
    needs = np.array(model.sensor_needstage)

    def only(mask: np.ndarray) -> Callable[[], None]:
        def prepare() -> None:
            model.sensor_needstage[:] = np.where(mask, needs, 0)

        return prepare

    try:
        yield only
    finally:
        model.sensor_needstage[:] = needs


def static_geoms(model: mujoco.MjModel) -> int:
    """Return how many geoms no joint moves, where sleep would leave out most of all; else 0."""
    count = int(np.count_nonzero(np.asarray(model.body_weldid)[model.geom_bodyid] == 0))
    is_most = 2 * count > model.ngeom
    return count if is_most and compat.flag_enabled(model, "sleep") is False else 0


def sensor_costs(
    model: mujoco.MjModel, start: Function, step_s: float, budget_s: float = BUDGET_S
) -> list[SensorCost]:
    """Return what the sensors of each type and stage cost of a step, the largest first."""
    if not model.nsensor or not compat.flag_enabled(model, "sensor"):
        return []
    types, needs = np.array(model.sensor_type), np.array(model.sensor_needstage)
    costs = []
    with _needed_sensors(model) as need_only:
        for stage in SensorStage:
            of_stage = needs == int(stage.need)
            kinds = sorted({int(kind) for kind in types[of_stage]})
            masks = [of_stage & (types == kind) for kind in kinds]
            if not masks:
                continue
            function = _afresh(stage.function)
            prepares = [need_only(mask) for mask in (np.zeros_like(of_stage), of_stage, *masks)]
            none_s, together_s, *alone_s = medians(
                model, start, [(prepare, function) for prepare in prepares], budget_s
            )
            types_s = [max(0.0, each_s - none_s) for each_s in alone_s]
            scale = max(0.0, together_s - none_s) / sum(types_s) if any(types_s) else 0.0
            for kind, mask, type_s in zip(kinds, masks, types_s, strict=True):
                name = compat.enum_name(mujoco.mjtSensor, kind, "mjSENS_")
                share = min(1.0, scale * type_s / step_s)
                costs.append(SensorCost(name, stage, int(mask.sum()), share))
    return sorted(costs, key=lambda cost: -cost.share)


def _afresh(function: Function) -> Function:
    """Return a function that computes what sensors share, as the first call of a step does."""

    def call(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        compat.forget_computed(data)
        function(model, data)

    return call


def medians(
    model: mujoco.MjModel,
    start: Function,
    contenders: Sequence[tuple[Callable[[], None], Function]],
    budget_s: float = BUDGET_S,
) -> list[float]:
    """Return the seconds of a call of each function on the same states, in turns.

    Each has a preparation of the model. Before a block, the state is computed with the first.
    """
    data, turn = mujoco.MjData(model), itertools.count()
    state = np.empty(compat.state_size(model))
    first, _ = contenders[0]

    def contender(prepare: Callable[[], None], function: Function, calls: int) -> timing.Contender:
        def before() -> None:
            if next(turn) % len(contenders) == 0:
                start(model, data)
                compat.get_state(model, data, state)
            first()
            compat.set_state(model, data, state)
            mujoco.mj_forward(model, data)
            prepare()

        def block() -> None:
            for _ in range(calls):
                function(model, data)

        return timing.Contender(block, before)

    once = [contender(prepare, function, 1) for prepare, function in contenders]
    once_s = [min(column) for column in zip(*timing.rounds(once, 0.0, 3, 3), strict=True)]
    calls = [max(1, int(BLOCK_S / max(seconds, 1e-7))) for seconds in once_s]
    timed = [contender(*each, count) for each, count in zip(contenders, calls, strict=True)]
    rounds = timing.rounds(timed, budget_s, LEAST_ROUNDS, MOST_ROUNDS)
    return [
        statistics.median(seconds) / count
        for seconds, count in zip(zip(*rounds, strict=True), calls, strict=True)
    ]


def stage_shares(timer_s: Mapping[str, float]) -> dict[str, float]:
    """Return the share of a step by stage, `other` included; they sum to 1.

    Args:
      timer_s: seconds by timer, without the `mjTIMER_` of its name; a timer that a release does not
        have may be missing.
    """
    stages = {stage: timer_s.get(timer, 0.0) for stage, timer in STAGES.items()}
    # The timer of collision includes its two phases: leave what they do not explain.
    phases = stages["broad-phase collision"] + stages["narrow-phase collision"]
    stages["collision"] = max(0.0, stages["collision"] - phases)
    total = max(timer_s.get("STEP", 0.0), sum(stages.values()), 1e-30)  # never 0, as it divides
    stages[OTHER] = total - sum(stages.values())
    return {stage: value / total for stage, value in stages.items()}
