"""Which geoms of a model can collide, by the filters of the engine's collision detection.

They are those of "Collision detection: Selection" in MuJoCo's documentation: static bodies, bodies
that are welded together, parent and child, `contype` and `conaffinity`, and `<exclude>`. Explicit
pairs (`<pair>`) bypass them and are not part of this.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat

# Geoms that can collide, at most: memory and time grow with their square.
MAX_GEOMS = 2000
# Pairs of geom types with a collision function of their own; planes have one with every type. All
# others are left to the iterative convex collider (mjCOLLISIONFUNC in the engine's source).
_OWN_FUNCTION = (
    ("SPHERE", "SPHERE"),
    ("SPHERE", "CAPSULE"),
    ("SPHERE", "CYLINDER"),
    ("SPHERE", "BOX"),
    ("CAPSULE", "CAPSULE"),
    ("CAPSULE", "BOX"),
    ("BOX", "BOX"),
)


@dataclass(frozen=True, eq=False)
class GeomPairs:
    """Pairs of geoms that the engine's filters let through.

    Attributes:
      geoms: (npair, 2) indices.
      bodies: (npair, 2) indices, the lower one first.
      are_bounded: (npair,) bool: whether joints bound how the two bodies can lie to each other,
        because neither can go anywhere (see `_anchors`).
      is_too_large: whether more than MAX_GEOMS geoms can collide; then there are no pairs here.
    """

    geoms: np.ndarray
    bodies: np.ndarray
    are_bounded: np.ndarray
    is_too_large: bool = False

    def only(self, mask: np.ndarray) -> "GeomPairs":
        return GeomPairs(self.geoms[mask], self.bodies[mask], self.are_bounded[mask])


def colliding_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Return the indices of the geoms that collide, explicit pairs included."""
    collides = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    collides[np.asarray(model.pair_geom1)] = True
    collides[np.asarray(model.pair_geom2)] = True
    return np.flatnonzero(collides)


def read(model: mujoco.MjModel) -> GeomPairs:
    geoms = colliding_geoms(model)
    is_too_large = len(geoms) > MAX_GEOMS
    is_enabled = all(compat.flag_enabled(model, name) for name in ("contact", "constraint"))
    if is_too_large or not is_enabled:
        none = np.empty((0, 2), dtype=int)
        return GeomPairs(none, none, np.empty(0, dtype=bool), is_too_large)
    first, second = (geoms[index] for index in np.triu_indices(len(geoms), k=1))
    body_of = np.asarray(model.geom_bodyid)
    passes = _compatible(model, first, second)
    passes &= ~_same_or_parent(model, body_of[first], body_of[second])
    passes &= ~_excluded(model, body_of[first], body_of[second])
    pairs = np.stack([first[passes], second[passes]], axis=1)
    bodies = np.sort(body_of[pairs], axis=1)
    anchors = _anchors(model)
    return GeomPairs(pairs, bodies, anchors[bodies[:, 0]] == anchors[bodies[:, 1]])


def are_planes(model: mujoco.MjModel) -> np.ndarray:
    return np.asarray(model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE))


def need_convex_collider(model: mujoco.MjModel, pairs: GeomPairs) -> bool:
    numbers = compat.members(mujoco.mjtGeom, "mjGEOM_")
    own = [{numbers[one], numbers[other]} for one, other in _OWN_FUNCTION]
    explicit = np.stack([np.asarray(model.pair_geom1), np.asarray(model.pair_geom2)], axis=1)
    types = np.asarray(model.geom_type)[np.concatenate([pairs.geoms, explicit]).astype(int)]
    return any(
        numbers["PLANE"] not in pair and set(pair) not in own
        for pair in np.unique(types, axis=0).tolist()
    )


def _compatible(model: mujoco.MjModel, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    contype, conaffinity = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    forward = contype[first] & conaffinity[second]
    backward = contype[second] & conaffinity[first]
    return np.asarray((forward | backward) != 0)


def _same_or_parent(model: mujoco.MjModel, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return (npair,) bool: whether bodies are welded together, static, or parent and child."""
    weld = np.asarray(model.body_weldid)
    parent = weld[np.asarray(model.body_parentid)[weld]]  # by body: of its weld group
    a, b = weld[first], weld[second]
    same = a == b
    if not compat.flag_enabled(model, "filterparent"):
        return np.asarray(same)
    related = (a == parent[second]) | (b == parent[first])
    return np.asarray(same | (related & (a != 0) & (b != 0)))


def _excluded(model: mujoco.MjModel, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    low, high = np.minimum(first, second), np.maximum(first, second)
    return np.isin((low << 16) + high, np.asarray(model.exclude_signature))


def _anchors(model: mujoco.MjModel) -> np.ndarray:
    """Return (nbody,) the body from which joints bound where each body can go.

    That is its nearest ancestor, or itself, which can go anywhere: by a free joint, by a slide
    joint without limits, or as a mocap body; the world where there is none. Two bodies with the
    same anchor meet in few poses; others meet wherever the simulation leads.
    """
    free, slide = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    kinds, limited = np.asarray(model.jnt_type), np.asarray(model.jnt_limited).astype(bool)
    is_anchor = np.asarray(model.body_mocapid) >= 0
    goes_anywhere = (kinds == free) | ((kinds == slide) & ~limited)
    is_anchor[np.asarray(model.jnt_bodyid)[goes_anywhere]] = True
    anchors = np.arange(model.nbody)
    for body in range(1, model.nbody):  # parents come before their children
        if not is_anchor[body]:
            anchors[body] = anchors[model.body_parentid[body]]
    return anchors
