"""A C function of the engine as control callback: a slowdown inside `mj_step`, of the same result.

MuJoCo calls `mjcb_control` in every step, after everything that follows from positions and
velocities. Each of the FUNCTIONS then computes what no step reads, or what is there already, so the
step takes longer and ends in the same state, to the last bit.
"""

import ctypes
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mjbench.errors import InputError
from mjbench.simulation import engine_library

if TYPE_CHECKING:
    import mujoco

# What each function computes. All take a model and its data, and leave the states of a step as they
# are. Not every such function does: mj_crb drops the armature of tendons from the inertia matrix,
# and mj_kinematics changes the states of free bodies in 2.3.7.
FUNCTIONS: Mapping[str, str] = {
    "mj_energyPos": "potential energy",
    "mj_energyVel": "kinetic energy",
    "mj_subtreeVel": "linear velocity and angular momentum of subtrees",
    "mj_comPos": "inertias and motion axes about the centres of mass",
    "mj_comVel": "spatial velocities",
    "mj_factorM": "factorisation of the inertia matrix",
}

_PROTOTYPE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


def install(model: "mujoco.MjModel", name: str) -> None:
    """Have every further step of this process call a function of the engine.

    Threads that step call it as well, and none of them waits for Python.

    Args:
      name: a C function that takes a model and its data.

    Raises:
      InputError: this release has no such function, or steps of the model call no callback.
      MachineError: the engine's library is not where the package has it.
    """
    import mujoco

    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        raise InputError(
            f"cannot call {name} inside a step: the model disables actuation, and with it callbacks"
        )
    try:
        function = _PROTOTYPE((name, engine_library.loaded()))
    except AttributeError:
        raise InputError(f"MuJoCo {mujoco.__version__} has no function {name}") from None
    mujoco.set_mjcb_control(function)
