"""Stages of a step: by the engine's own timers, and what has none, such as sensors.

A stage without a timer is called again and again on states after `mj_forward`. It computes the same
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
from mjbench.commands.profile.evaluations import Evaluations
from mjbench.measuring import timing
from mjbench.simulation import compat

# Seconds for the parts of one kind; rounds, and seconds of a block.
BUDGET_S = 0.5
LEAST_ROUNDS, MOST_ROUNDS, BLOCK_S = 7, 200, 0.0005

# A function of the engine, or what brings an MjData to a start state.
Function = Callable[[mujoco.MjModel, mujoco.MjData], None]


class Stage(enum.StrEnum):
    """A stage of a step, as every command names it."""

    KINEMATICS = "kinematics"
    TENDONS = "tendons"
    INERTIA = "inertia"
    BROAD_PHASE = "broad-phase collision"
    NARROW_PHASE = "narrow-phase collision"
    COLLISION = "collision"
    CONSTRAINT_MAKING = "constraint making"
    CONSTRAINT_PROJECTION = "constraint projection"
    VELOCITY = "velocity"
    PASSIVE = "passive forces with plugins"
    ACTUATION = "actuation"
    ACCELERATION = "smooth acceleration"
    SOLVER = "constraint solver"
    SENSORS = "sensors"
    ENERGY = "energy"
    INTEGRATION = "integration"
    CHECKS = "checks of the state"
    OTHER = "other"
    """What neither timers nor calls of the engine's functions explain."""


# The timer of MuJoCo (mjtTimer) of each stage that has one; other stages are timed by calls.
TIMERS: Mapping[Stage, str] = {
    Stage.KINEMATICS: "POS_KINEMATICS",
    Stage.INERTIA: "POS_INERTIA",
    Stage.BROAD_PHASE: "COL_BROAD",
    Stage.NARROW_PHASE: "COL_NARROW",
    Stage.COLLISION: "POS_COLLISION",
    Stage.CONSTRAINT_MAKING: "POS_MAKE",
    Stage.CONSTRAINT_PROJECTION: "POS_PROJECT",
    Stage.VELOCITY: "VELOCITY",
    Stage.ACTUATION: "ACTUATION",
    Stage.SOLVER: "CONSTRAINT",
    Stage.INTEGRATION: "ADVANCE",
}
COLLISION = (Stage.BROAD_PHASE, Stage.NARROW_PHASE, Stage.COLLISION)
WHOLE_STEP = "STEP"  # the timer of all of a step


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
    """A stage that is timed by calls; the timer of `within` includes it."""

    stage: Stage
    within: Stage
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
            apart[part.stage] = apart.get(part.stage, 0.0) + scale * part.share
        apart[stage] = max(0.0, share - scale * total)
    return apart


@dataclass(frozen=True)
class StepStages:
    """Where the time of a step goes.

    Attributes:
      shares: of a step, by stage; they sum to 1.
      sensors: by type, the largest first.
    """

    step_s: float
    shares: Mapping[str, float]
    sensors: Sequence[SensorCost]


def stages(
    model: mujoco.MjModel,
    timer_shares: Mapping[str, float],
    new_start: Callable[[], Function],
    budget_s: float = BUDGET_S,
) -> StepStages:
    """Return all stages of a step: those of the timers, and those that calls time.

    Args:
      timer_shares: as `stage_shares` returns them.
      budget_s: for each of a step, its sensors and its other parts.
    """
    (step_s,) = medians(model, new_start(), [(lambda: None, mujoco.mj_step)], budget_s)
    sensors = sensor_costs(model, new_start(), step_s, budget_s / len(SensorStage))
    timed = parts(model, new_start(), step_s, sensors, budget_s)
    return StepStages(step_s, with_parts(timer_shares, timed), sensors)


def longest(shares: Mapping[str, float]) -> tuple[str, float]:
    """Return the stage that takes most of a step, and its share; collision is one stage here."""
    whole = {stage: share for stage, share in shares.items() if stage not in COLLISION}
    whole.pop(Stage.OTHER, None)
    whole[Stage.COLLISION] = sum(shares.get(stage, 0.0) for stage in COLLISION)
    return max(whole.items(), key=lambda item: item[1])


def parts(
    model: mujoco.MjModel,
    start: Function,
    step_s: float,
    sensors: Sequence[SensorCost],
    budget_s: float = BUDGET_S,
) -> list[StepPart]:
    """Return the stages that no timer of the engine is about."""
    functions = list(_functions(model))
    with _needed_sensors(model) as need_only:
        need_none = need_only(np.zeros(model.nsensor, dtype=bool))
        nothing = need_none, mujoco.mj_sensorVel  # what a call costs by itself
        calls = [(need_none, function) for _, _, _, function in functions]
        of_call_s, *of_parts_s = medians(model, start, [nothing, *calls], budget_s)
    total = sum(each.share for each in sensors)
    timed = [StepPart(Stage.SENSORS, Stage.OTHER, total)] if sensors else []
    for (stage, within, count, _), part_s in zip(functions, of_parts_s, strict=True):
        share = count * max(0.0, part_s - of_call_s) / step_s
        timed.append(StepPart(stage, within, share))
    return timed


def _functions(model: mujoco.MjModel) -> Iterator[tuple[Stage, Stage, int, Function]]:
    """Yield a stage, that whose timer includes it, how often a step calls it, and its function."""
    count = Evaluations.of(model).of_step
    yield Stage.ACCELERATION, Stage.OTHER, count, mujoco.mj_fwdAcceleration
    for name in ("Pos", "Vel", "Acc"):
        yield Stage.CHECKS, Stage.OTHER, 1, getattr(mujoco, f"mj_check{name}")
    if compat.flag_enabled(model, "energy"):
        for name in ("Pos", "Vel"):
            yield Stage.ENERGY, Stage.OTHER, 1, getattr(mujoco, f"mj_energy{name}")
    if model.ntendon:
        yield Stage.TENDONS, Stage.KINEMATICS, count, mujoco.mj_tendon
    if model.nplugin:
        yield Stage.PASSIVE, Stage.VELOCITY, count, mujoco.mj_passive


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
    seconds = {stage: timer_s.get(timer, 0.0) for stage, timer in TIMERS.items()}
    # The timer of collision includes its two phases: leave what they do not explain.
    phases = seconds[Stage.BROAD_PHASE] + seconds[Stage.NARROW_PHASE]
    seconds[Stage.COLLISION] = max(0.0, seconds[Stage.COLLISION] - phases)
    total = max(timer_s.get(WHOLE_STEP, 0.0), sum(seconds.values()), 1e-30)  # as it divides
    seconds[Stage.OTHER] = total - sum(seconds.values())
    return {stage: value / total for stage, value in seconds.items()}
