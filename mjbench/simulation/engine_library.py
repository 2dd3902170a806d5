"""The C library of MuJoCo that this process has loaded, for what Python does not offer."""

import ctypes
import functools
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.errors import InputError, MachineError, one_line

if TYPE_CHECKING:
    import mujoco

# Functions that steps can call (see `install_callback`), and what each computes. All take a model
# and its data, and leave the states of a step as they are. Not every such function does: mj_crb
# drops the armature of tendons from the inertia matrix, and mj_kinematics changes the states of
# free bodies in 2.3.7.
FUNCTIONS: Mapping[str, str] = {
    "mj_energyPos": "potential energy",
    "mj_energyVel": "kinetic energy",
    "mj_subtreeVel": "linear velocity and angular momentum of subtrees",
    "mj_comPos": "inertias and motion axes about the centres of mass",
    "mj_comVel": "spatial velocities",
    "mj_factorM": "factorisation of the inertia matrix",
}

_PROTOTYPE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


@functools.cache  # a timed block may ask for it
def loaded() -> ctypes.CDLL:
    """Return the library that `mujoco` uses; MachineError where it lies elsewhere than usual."""
    from mujoco import _functions

    # The library is not everywhere beside the extension modules, but they find its symbols.
    file = _functions.__file__
    if sys.platform == "win32":
        file = str(Path(file).with_name("mujoco.dll"))
    try:
        return ctypes.CDLL(file, mode=getattr(os, "RTLD_NOLOAD", ctypes.DEFAULT_MODE))
    except OSError as error:
        raise MachineError(f"{file} is not loaded: {one_line(error)}") from error


def install_callback(model: "mujoco.MjModel", name: str) -> None:
    """Have every further step of this process call a function of the engine: a slower `mj_step`.

    MuJoCo calls `mjcb_control` in every step, after everything that follows from positions and
    velocities. Each of the FUNCTIONS then computes what no step reads, or what is there already, so
    the step ends in the same state, to the last bit. Threads that step call it as well, and none of
    them waits for Python.

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
        function = _PROTOTYPE((name, loaded()))
    except AttributeError:
        raise InputError(f"MuJoCo {mujoco.__version__} has no function {name}") from None
    mujoco.set_mjcb_control(function)
