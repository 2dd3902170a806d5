"""What costs in the steps of a program: stages of the engine, pairs of geoms, and sensors.

The program's own model is stepped from states that the program was in, in a child process.
"""

import enum
import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, Share
from mjbench.commands.profile import measure as profile
from mjbench.commands.profile import step_parts
from mjbench.commands.profile.loop_starts import LEAST_NSTEP, StartsInTurn
from mjbench.commands.profile.step_parts import OTHER
from mjbench.commands.run.recorded_models import RecordedModel, loadable
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.simulation import compat, geom_pairs, reference_run

# Seconds to time pairs, and sensors; a child that is silent for longer than the limit is killed.
BUDGET_S, LIMIT_S = 1.0, 30.0
# Rounds, and seconds of a block.
LEAST_ROUNDS, BLOCK_S = 7, 0.001
# Pairs that are timed of two types that come as near, and of all; costs that are stored.
PAIRS_OF_GROUP, MOST_PAIRS, MOST_COSTS = 8, 64, 6
# A smaller share of a step is within what the times vary by.
LEAST_SHARE = 0.02


class CostKind(enum.StrEnum):
    """What costs."""

    PAIR = "pair of geoms"
    """The narrow phase of the collision of two geoms."""
    TYPES = "pairs of types"
    """That of all geoms of two types, one with another."""
    SENSORS = "sensors"
    """All sensors of one type."""
    STATIC = "geoms"
    """Those that no joint moves: their part of all geoms is taken to be that of kinematics."""


class Nearness(enum.IntEnum):
    """How near two geoms came."""

    FAR = 0
    NEAR = 1
    """Their bounding spheres overlapped."""
    TOUCHING = 2


@dataclass(frozen=True)
class Cost:
    """What a part of the model costs.

    Attributes:
      kind: of the part.
      name: of the geoms, or of the types.
      count: pairs, or sensors.
      share: of the time of a step.
    """

    kind: CostKind
    name: str
    count: NonNegativeInt
    share: Share


@dataclass(frozen=True)
class PhysicsCost:
    """Where the time of a program's steps goes.

    Attributes:
      step_ns: a step from the states that the program was in.
      stages: share of a step by stage, as timed in the program; where that was not possible, from
        the states that it was in.
      costs: parts of the model with a notable share, the largest first.
    """

    step_ns: NonNegativeFloat
    stages: Mapping[str, Share]
    costs: Sequence[Cost]

    @property
    def main_stage(self) -> tuple[str, float]:
        """The stage that takes most of a step, and its share; collision is one stage here."""
        is_phase = {name: "collision" in name for name in self.stages}
        parts = {name: share for name, share in self.stages.items() if not is_phase[name]}
        parts.pop(OTHER, None)
        parts["collision"] = sum(share for name, share in self.stages.items() if is_phase[name])
        return max(parts.items(), key=lambda part: part[1])

    @property
    def main_cost(self) -> Cost | None:
        kinds = {
            "sensors": (CostKind.SENSORS,),
            "collision": (CostKind.PAIR, CostKind.TYPES),
            "kinematics": (CostKind.STATIC,),
        }.get(self.main_stage[0], ())
        return next((cost for cost in self.costs if cost.kind in kinds), None)


def measure(models: Sequence[RecordedModel], stages: Mapping[str, float]) -> PhysicsCost | None:
    """Return what costs in steps; None where no model can be stepped here."""
    model = loadable(models)
    if model is None:
        return None
    return isolate.call(measure_model, model, stages, limit_s=LIMIT_S, otherwise=lambda _: None)


def measure_model(
    recorded: RecordedModel, stages: Mapping[str, float], channel: Channel
) -> PhysicsCost:
    model, states = recorded.load(), recorded.states
    step_s = step_parts.step_s(model, StartsInTurn(model, states))
    sensors = step_parts.sensor_costs(model, StartsInTurn(model, states), step_s)
    stages = stages or _stages(model, states)
    if step_parts.SENSORS not in stages:  # timed in the program, by the engine's timers alone
        stages = step_parts.with_parts(stages, step_parts.of_sensors(sensors))
    of_sensors = [Cost(CostKind.SENSORS, each.type, each.count, each.share) for each in sensors]
    narrow_share = stages["narrow-phase collision"]
    has_pairs = narrow_share >= LEAST_SHARE
    of_pairs = _pairs(model, states, narrow_share, step_s) if has_pairs else ()
    of_static = []
    if count := step_parts.static_geoms(model):
        share = stages.get("kinematics", 0.0) * count / model.ngeom
        of_static.append(Cost(CostKind.STATIC, "geoms that no joint moves", count, share))
    costs = [*of_pairs, *of_sensors, *of_static]
    largest = sorted(costs, key=lambda cost: -cost.share)
    notable = [cost for cost in largest if cost.share >= LEAST_SHARE]
    return PhysicsCost(1e9 * step_s, stages, notable[:MOST_COSTS])


def _stages(model: mujoco.MjModel, states: np.ndarray) -> Mapping[str, float]:
    nstep = max(LEAST_NSTEP, int(profile.BLOCK_S / reference_run.step_s(model) / len(states)))
    block = profile.Block(len(states), nstep, lambda: StartsInTurn(model, states))
    return profile.stages(model, block)


def _pairs(
    model: mujoco.MjModel, states: np.ndarray, narrow_share: float, step_s: float
) -> Iterator[Cost]:
    """Yield what collisions of geoms cost, by types, and of the pair that costs most.

    `mj_collision` is timed where only one pair may collide, and where only one may that is far
    apart. What is more for a pair is its weight in the share of the narrow phase.
    """
    pairs = geom_pairs.read(model).geoms
    nearness = _nearness(model, states, pairs)
    groups: dict[tuple[str, Nearness], list[tuple[int, int]]] = defaultdict(list)
    for (first, second), each in zip(pairs, nearness, strict=True):
        if each != Nearness.FAR:
            types = " and ".join(sorted(_type_name(model, geom) for geom in (first, second)))
            groups[types, Nearness(each)].append((int(first), int(second)))
    affordable = int(BUDGET_S / LEAST_ROUNDS / (BLOCK_S + 2 * step_s))
    spread_pairs = [
        pair
        for group in groups.values()
        for pair in group[:: math.ceil(len(group) / PAIRS_OF_GROUP)]
    ]
    timed = spread_pairs[: min(MOST_PAIRS, max(1, affordable))]
    if not timed:
        return
    far = [int(geom) for geom in pairs[nearness == Nearness.FAR][:1].flat]
    weights = _weights(model, states, timed, far)
    of_types: dict[str, float] = defaultdict(float)
    counts = Counter[str]()
    for (types, _), group in groups.items():
        weights_of_group = [weights[pair] for pair in group if pair in weights]
        counts[types] += len(group)
        if weights_of_group:
            of_types[types] += len(group) * statistics.fmean(weights_of_group)
    total = sum(of_types.values())
    if not total > 0:
        return
    for types, weight in of_types.items():
        if counts[types] > 1:
            yield Cost(CostKind.TYPES, types, counts[types], narrow_share * weight / total)
    pair = max(timed, key=lambda each: weights[each])
    names = " and ".join(_geom_name(model, geom) for geom in pair)
    yield Cost(CostKind.PAIR, names, 1, narrow_share * weights[pair] / total)


def _weights(
    model: mujoco.MjModel, states: np.ndarray, pairs: Sequence[tuple[int, int]], far: Sequence[int]
) -> dict[tuple[int, int], float]:
    """Return the seconds that each pair adds to `mj_collision`, more than one that is far apart."""
    contype, conaffinity = np.array(model.geom_contype), np.array(model.geom_conaffinity)

    def only(pair: Sequence[int]) -> Callable[[], None]:
        def prepare() -> None:
            model.geom_contype[:] = model.geom_conaffinity[:] = 0
            model.geom_contype[list(pair)] = model.geom_conaffinity[list(pair)] = 1

        return prepare

    def restore() -> None:
        model.geom_contype[:], model.geom_conaffinity[:] = contype, conaffinity

    prepares = [restore, *(only(pair) for pair in (far, *pairs))]
    contenders = [(prepare, mujoco.mj_collision) for prepare in prepares]
    start = StartsInTurn(model, states)
    _, far_s, *pairs_s = step_parts.medians(model, start, contenders, BUDGET_S)
    restore()
    return {pair: max(0.0, each_s - far_s) for pair, each_s in zip(pairs, pairs_s, strict=True)}


def _nearness(model: mujoco.MjModel, states: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return (npair,) how near two geoms came to each other in the states."""
    data = mujoco.MjData(model)
    nearness = np.zeros(len(pairs), dtype=int)
    nearness[np.asarray(model.geom_rbound == 0)[pairs].any(axis=1)] = Nearness.NEAR  # a plane
    reach = (model.geom_rbound + model.geom_margin)[pairs].sum(axis=1)
    for state in states:
        compat.set_state(model, data, state)
        mujoco.mj_forward(model, data)
        first, second = (data.geom_xpos[pairs[:, i]] for i in range(2))
        is_near = np.linalg.norm(first - second, axis=1) < reach
        touching = {tuple(sorted(map(int, contact.geom))) for contact in data.contact}
        touches = [tuple(sorted(map(int, pair))) in touching for pair in pairs]
        nearness = np.maximum(nearness, np.where(touches, Nearness.TOUCHING, is_near))
    return nearness


def _type_name(model: mujoco.MjModel, geom: int) -> str:
    return str(mujoco.mjtGeom(int(model.geom_type[geom])).name).removeprefix("mjGEOM_").lower()


def _geom_name(model: mujoco.MjModel, geom: int) -> str:
    kind, name = _type_name(model, geom), model.geom(geom).name
    if name:
        return f"{kind} “{name}”"
    body = model.body(int(model.geom_bodyid[geom])).name
    return f"{kind} {geom} of body “{body}”" if body else f"{kind} {geom}"
