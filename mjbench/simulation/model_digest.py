"""Which models cost the same: a digest of what decides the work of a step.

It names a model in the table of step costs (`verification.step_costs`). It is made of fields
that every release compiles alike, by name and rounded, so a model usually has the same digest in
every release.
"""

import hashlib

import mujoco
import numpy as np

from mjbench.simulation import compat

# Numbers of elements; a release that lacks one has none of them.
_SIZES = (
    *("nq", "nv", "nu", "na", "nbody", "njnt", "ngeom", "nsite", "neq", "ntendon", "nsensor"),
    *("nmesh", "nmeshvert", "nmeshface", "nhfield", "nhfielddata", "nflex", "nflexvert"),
    *("nflexelem", "npair", "nexclude", "nmocap", "nM"),
)
# How elements are connected, and what can touch.
_STRUCTURE = (
    *("body_parentid", "body_mocapid", "jnt_type", "jnt_bodyid", "jnt_limited"),
    *("geom_type", "geom_bodyid", "geom_contype", "geom_conaffinity", "geom_condim"),
    *("eq_type", "tendon_limited", "wrap_type", "actuator_trntype", "actuator_trnid"),
    *("actuator_gaintype", "actuator_biastype", "actuator_ctrllimited"),
)
# Where elements are, and how they move; in SI units.
_QUANTITIES = (
    *("qpos0", "key_qpos", "key_ctrl", "body_pos", "body_mass", "jnt_range", "dof_damping"),
    *("dof_armature", "dof_frictionloss", "geom_pos", "geom_size", "geom_friction", "geom_margin"),
    *("actuator_ctrlrange", "actuator_gear", "hfield_data"),
)
_OPTIONS = (
    *("timestep", "impratio", "tolerance", "noslip_tolerance", "iterations", "noslip_iterations"),
    *("integrator", "cone", "solver", "jacobian"),
)
# Decimals to which quantities are rounded: compilers of different releases differ in the last bits.
_DECIMALS = 6


def model_digest(model: mujoco.MjModel) -> str:
    """Return 16 hexadecimal digits that name what decides the cost of a model's steps.

    Names do not count, nor does what is only drawn.
    """
    content = hashlib.blake2b(digest_size=8)
    for name in _SIZES:
        content.update(f"{name} {int(getattr(model, name, 0))};".encode())
    for name in _STRUCTURE:
        content.update(np.asarray(getattr(model, name)).astype(np.int64).tobytes())
    for name in _QUANTITIES:
        rounded = np.round(np.asarray(getattr(model, name), dtype=float), _DECIMALS)
        content.update((rounded + 0.0).tobytes())  # -0.0 + 0.0 is 0.0
    for name in _OPTIONS:
        content.update(f"{name} {float(getattr(model.opt, name)):.6g};".encode())
    content.update(" ".join(compat.flag_names(model)).encode())
    return content.hexdigest()
