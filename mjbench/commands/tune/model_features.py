"""Which features of the engine a model uses."""

import mujoco
import numpy as np

from mjbench.simulation import compat, geom_pairs

_TENDON_FORCES = (
    *("tendon_stiffness", "tendon_stiffnesspoly", "tendon_damping", "tendon_dampingpoly"),
    *("tendon_frictionloss", "tendon_armature"),
)


def is_zero(model: mujoco.MjModel, term: str) -> bool:
    """Return whether all arrays of a model whose names end in `term`, or in `termpoly`, are zero.

    Looked up by name, as releases add some: `stiffness` stands for `jnt_stiffness`,
    `tendon_stiffness`, `jnt_stiffnesspoly`, ….
    """
    names = [name for name in dir(model) if name.endswith((f"_{term}", f"_{term}poly"))]
    return not any(np.any(getattr(model, name)) for name in names)


def can_collide(model: mujoco.MjModel) -> bool:
    pairs = geom_pairs.read(model)
    return bool(pairs.is_too_large or len(pairs.geoms) or model.npair or model.nflex)


def needs_convex_collider(model: mujoco.MjModel) -> bool:
    pairs = geom_pairs.read(model)
    return pairs.is_too_large or geom_pairs.need_convex_collider(model, pairs)


def has_compound_bodies(model: mujoco.MjModel) -> bool:
    """Return whether a body has several geoms that collide, so that it has a bounding tree."""
    bodies = np.asarray(model.geom_bodyid)[geom_pairs.colliding_geoms(model)]
    return len(np.unique(bodies)) < len(bodies)


def can_sleep(model: mujoco.MjModel) -> bool:
    """Return whether the release knows sleep, and some tree of the model is allowed to."""
    if compat.flag_enabled(model, "sleep") is None:
        return False
    policies = mujoco.mjtSleepPolicy
    allowed = [getattr(policies, f"mjSLEEP_{name}") for name in ("AUTO_ALLOWED", "ALLOWED", "INIT")]
    return bool(np.isin(model.tree_sleep_policy, [int(policy) for policy in allowed]).any())


def hull_vertices(model: mujoco.MjModel) -> int:
    """Return how many vertices the largest convex hull of a mesh that collides has."""
    geoms = geom_pairs.colliding_geoms(model)
    geoms = geoms[np.asarray(model.geom_type)[geoms] == int(mujoco.mjtGeom.mjGEOM_MESH)]
    starts = np.asarray(model.mesh_graphadr)[np.asarray(model.geom_dataid)[geoms]]
    return int(np.asarray(model.mesh_graph)[starts[starts >= 0]].max(initial=0))


def has_signed_distances(model: mujoco.MjModel) -> bool:
    """Return whether a geom collides by its signed distance field."""
    kinds = np.asarray(model.geom_type)[geom_pairs.colliding_geoms(model)]
    return int(mujoco.mjtGeom.mjGEOM_SDF) in kinds


def unused_tendons(model: mujoco.MjModel) -> list[str]:
    """Return the names of the tendons that exert no force, and that nothing refers to."""
    if not model.ntendon:
        return []
    tendon = int(mujoco.mjtObj.mjOBJ_TENDON)
    is_used = np.asarray(model.tendon_limited).astype(bool)
    for name in _TENDON_FORCES:
        values = getattr(model, name, np.zeros(model.ntendon))  # releases add some
        is_used |= np.asarray(values).reshape(model.ntendon, -1).any(axis=1)
    by_tendon = int(mujoco.mjtTrn.mjTRN_TENDON)
    equality = int(mujoco.mjtEq.mjEQ_TENDON)
    for kinds, ids, kind in (
        (model.actuator_trntype, model.actuator_trnid[:, 0], by_tendon),
        (model.eq_type, model.eq_obj1id, equality),
        (model.eq_type, model.eq_obj2id, equality),
        (model.sensor_objtype, model.sensor_objid, tendon),
        (model.sensor_reftype, model.sensor_refid, tendon),
        (model.tuple_objtype, model.tuple_objid, tendon),
    ):
        ids = np.asarray(ids)[np.asarray(kinds) == kind]
        is_used[ids[ids >= 0]] = True
    names = [mujoco.mj_id2name(model, tendon, index) for index in np.flatnonzero(~is_used)]
    return [name for name in names if name]


def drawn_geoms(model: mujoco.MjModel) -> int:
    """Return how many geoms are only drawn: nothing collides with them, or refers to them.

    These are about those that `discardvisual` discards.
    """
    geom = int(mujoco.mjtObj.mjOBJ_GEOM)
    only_drawn = np.ones(model.ngeom, dtype=bool)
    only_drawn[geom_pairs.colliding_geoms(model)] = False
    for types, ids in (
        (model.sensor_objtype, model.sensor_objid),
        (model.sensor_reftype, model.sensor_refid),
        (model.tuple_objtype, model.tuple_objid),
    ):
        only_drawn[np.asarray(ids)[np.asarray(types) == geom]] = False
    wraps = [int(getattr(mujoco.mjtWrap, f"mjWRAP_{name}")) for name in ("SPHERE", "CYLINDER")]
    only_drawn[np.asarray(model.wrap_objid)[np.isin(model.wrap_type, wraps)]] = False
    only_drawn &= np.asarray(model.geom_fluid)[:, 0] == 0  # no ellipsoid fluid model
    return int(only_drawn.sum())


def absent(model: mujoco.MjModel) -> dict[str, str]:
    """Return what a model does not have, such as `joint limits`, by the flag that disables it.

    Disabling `spring` and `damper` together disables all passive forces, so `damper` is left out
    where others act.
    """
    no_collision = not can_collide(model)
    no_friction_loss = is_zero(model, "frictionloss")
    no_limits = not (np.any(model.jnt_limited) or np.any(model.tendon_limited))
    no_springs = not model.nflex and is_zero(model, "stiffness")
    no_dampers = not model.nflex and is_zero(model, "damping")
    no_constraints = not model.neq and no_friction_loss and no_limits and no_collision
    needs_damper_flag = no_springs and _has_other_passive_forces(model)
    features = (
        (not model.neq, "equality", "equality constraints"),
        (no_friction_loss, "frictionloss", "friction loss"),
        (no_limits, "limit", "joint limits"),
        (no_collision, "contact", "geoms that can collide"),
        (no_constraints, "constraint", "constraints"),
        (not model.nu, "actuation", "actuators"),
        (not model.nsensor, "sensor", "sensors"),
        (no_springs, "spring", "springs"),
        (no_dampers and not needs_damper_flag, "damper", "dampers"),
    )
    return {flag: plural for is_absent, flag, plural in features if is_absent}


def _has_other_passive_forces(model: mujoco.MjModel) -> bool:
    fluid = model.opt.density or model.opt.viscosity
    return bool(fluid or model.nplugin or np.any(model.body_gravcomp))
