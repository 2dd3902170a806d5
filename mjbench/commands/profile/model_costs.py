"""What parts of a model cost in a step: pairs of geoms, whose collisions are timed, and sensors."""

import enum
import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeInt, Share
from mjbench.commands.profile import step_parts
from mjbench.commands.profile.loop_starts import StartsInTurn
from mjbench.commands.profile.step_parts import Stage, StepStages
from mjbench.formats import whole_percent
from mjbench.simulation import compat, geom_pairs

# Seconds to time pairs; rounds, and seconds of a block.
BUDGET_S, LEAST_ROUNDS, BLOCK_S = 1.0, 7, 0.001
# Pairs that are timed of two types that come as near, and of all.
PAIRS_OF_GROUP, MOST_PAIRS = 8, 64
# Costs that are stored.
MOST_COSTS = 6
# A smaller share of a step is within what the times vary by.
LEAST_SHARE = 0.02
_LESS_OFTEN = (
    'with interval="0.1" nsample="1", a sensor is computed each 0.1 s; interval alone skips no step'
)
# Geoms whose collisions cost by how finely they are divided.
_HFIELD, _MESH = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_MESH)


class CostKind(enum.StrEnum):
    """What costs."""

    PAIR = "pair of geoms"
    """The narrow phase of the collision of two geoms."""
    TYPES = "pairs of types"
    """That of all geoms of two types, one with another."""
    SENSORS = "sensors"
    """All sensors of one type."""
    STATIC = "static geoms"
    """Kinematics of geoms that no joint moves, taken to be their part of all geoms."""


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
      detail: the finest height field or mesh of them, with its cells or vertices; of sensors, what
        computes them less often; "" for none.
    """

    kind: CostKind
    name: str
    count: NonNegativeInt
    share: Share
    detail: str = ""

    def __str__(self) -> str:
        plural = "" if self.kind == CostKind.PAIR else f" ({self.count:,})"
        detail = f"; {self.detail}" if self.detail else ""
        return f"{self.name}{plural}: {whole_percent(self.share)}{detail}"


def main_cost(stages: Mapping[str, float], costs: Sequence[Cost]) -> Cost | None:
    """Return what costs most, of `costs` with the largest first, in the longest stage of a step."""
    of_collision = (CostKind.PAIR, CostKind.TYPES)
    kinds: Mapping[str, Sequence[CostKind]] = {
        Stage.SENSORS: (CostKind.SENSORS,),
        Stage.COLLISION: of_collision,
        Stage.KINEMATICS: (CostKind.STATIC,),
    }
    longest, _ = step_parts.longest(stages)
    return next((cost for cost in costs if cost.kind in kinds.get(longest, ())), None)


def collision_costs(
    model: mujoco.MjModel,
    states: np.ndarray,
    stages: Mapping[str, float],
    step_s: float,
    budget_s: float = BUDGET_S,
) -> list[Cost]:
    """Return what collisions of geoms cost of a step, the largest first; none of a small share.

    Args:
      states: (nstate, size) from which a step is timed.
      budget_s: to time pairs.
    """
    narrow_share = stages.get(Stage.NARROW_PHASE, 0.0)
    if narrow_share < LEAST_SHARE:
        return []
    costs = _pairs(model, states, narrow_share, step_s, budget_s)
    return sorted(costs, key=lambda cost: -cost.share)


def sensor_costs(model: mujoco.MjModel, step: StepStages) -> list[Cost]:
    """Return what sensors cost by type, and how to compute them less often, if this release can.

    Together they cost no more than their stage, which was timed at another time.
    """
    intervals = getattr(model, "sensor_interval", None)
    detail = "" if intervals is None or np.any(intervals) else _LESS_OFTEN
    total = sum(each.share for each in step.sensors)
    scale = min(1.0, step.shares.get(Stage.SENSORS, 0.0) / total) if total else 0.0
    return [
        Cost(CostKind.SENSORS, each.type, each.count, scale * each.share, detail)
        for each in step.sensors
    ]


def static_geoms(model: mujoco.MjModel) -> int:
    """Return how many geoms no joint moves, where sleep would leave out most of all geoms; or 0."""
    if not compat.sleep_skips_static() or compat.flag_enabled(model, "sleep") is not False:
        return 0
    count = int(np.count_nonzero(np.asarray(model.body_weldid)[model.geom_bodyid] == 0))
    return count if 2 * count > model.ngeom else 0


def static_costs(model: mujoco.MjModel, stages: Mapping[str, float]) -> list[Cost]:
    """Return what geoms cost that no joint moves, where sleep would leave out most of all geoms."""
    if not (count := static_geoms(model)):
        return []
    share = stages.get(Stage.KINEMATICS, 0.0) * count / model.ngeom
    name = 'static geoms, which <flag sleep="enable"/> would leave out'
    return [Cost(CostKind.STATIC, name, count, share)] if share >= LEAST_SHARE else []


def _pairs(
    model: mujoco.MjModel,
    states: np.ndarray,
    narrow_share: float,
    step_s: float,
    budget_s: float = BUDGET_S,
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
    affordable = int(budget_s / LEAST_ROUNDS / (BLOCK_S + 2 * step_s))
    spread_pairs = [
        pair
        for group in groups.values()
        for pair in group[:: math.ceil(len(group) / PAIRS_OF_GROUP)]
    ]
    timed = spread_pairs[: min(MOST_PAIRS, max(1, affordable))]
    if not timed:
        return
    far = [int(geom) for geom in pairs[nearness == Nearness.FAR][:1].flat]
    weights = _weights(model, states, timed, far, budget_s)
    of_types: dict[str, float] = defaultdict(float)
    counts = Counter[str]()
    geoms: dict[str, set[int]] = defaultdict(set)
    for (types, _), group in groups.items():
        weights_of_group = [weights[pair] for pair in group if pair in weights]
        counts[types] += len(group)
        geoms[types].update(geom for pair in group for geom in pair)
        if weights_of_group:
            of_types[types] += len(group) * statistics.fmean(weights_of_group)
    total = sum(of_types.values())
    if not total > 0:
        return
    for types, weight in of_types.items():
        if counts[types] > 1:
            shape, share = _finest(model, geoms[types]), narrow_share * weight / total
            yield Cost(CostKind.TYPES, types, counts[types], share, shape)
    pair = max(timed, key=lambda each: weights[each])
    names = " and ".join(_geom_name(model, geom) for geom in pair)
    share = narrow_share * weights[pair] / total
    yield Cost(CostKind.PAIR, names, 1, share, _finest(model, pair))


def _weights(
    model: mujoco.MjModel,
    states: np.ndarray,
    pairs: Sequence[tuple[int, int]],
    far: Sequence[int],
    budget_s: float,
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
    _, far_s, *pairs_s = step_parts.medians(model, start, contenders, budget_s)
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


def _finest(model: mujoco.MjModel, geoms: Iterable[int]) -> str:
    """Return the height field or mesh of most cells or vertices; "" of other geoms."""
    shapes = [_shape(model, geom) for geom in geoms if model.geom_type[geom] in (_HFIELD, _MESH)]
    return max(shapes, default=(0, ""))[1]


def _shape(model: mujoco.MjModel, geom: int) -> tuple[int, str]:
    """Return how many cells or vertices a geom has, and a sentence that says so."""
    asset = int(model.geom_dataid[geom])
    if model.geom_type[geom] == _HFIELD:
        rows, columns = int(model.hfield_nrow[asset]) - 1, int(model.hfield_ncol[asset]) - 1
        name = model.hfield(asset).name or str(asset)
        return rows * columns, f"height field “{name}” has {rows:,} × {columns:,} cells"
    count, graph = int(model.mesh_vertnum[asset]), int(model.mesh_graphadr[asset])
    hull = f", {int(model.mesh_graph[graph]):,} of them on its hull" if graph >= 0 else ""
    return count, f"mesh “{model.mesh(asset).name or asset}” has {count:,} vertices{hull}"
