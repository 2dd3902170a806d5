"""Slowdowns of the candidate: of known size around each block, or inside each step."""

import ctypes
import functools
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import mujoco

from mjbench.errors import InputError
from mjbench.paired.loop_sections import LoopSection
from mjbench.paired.worker import Worker, activity
from mjbench.simulation.engine_clock import engine_library

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


def slowed_run(slowdown: float = 0.0, callback: str = "") -> Callable[..., int]:
    """Return the task that prepares a slower run.

    Args:
      slowdown: share of its time by which each block lasts longer: the process spins meanwhile.
      callback: function of the engine that steps call (see `install_callback`).
    """
    task = functools.partial(_prepare_run, slowdown=slowdown, callback=callback)
    return activity("preparing a run")(task)


def _prepare_run(
    worker: Worker, *arguments: Any, slowdown: float, callback: str, **named: Any
) -> int:
    if callback:
        install_callback(worker.model, callback)
    ns = worker.prepare_run(*arguments, **named)
    if slowdown:
        worker.sections = [slowed_section(section, slowdown) for section in worker.sections]
    return round((1 + slowdown) * ns)


def slowed_section(section: LoopSection, slowdown: float) -> LoopSection:
    """Return a section that takes longer by a share; its reading is that time, to the nanosecond.

    How late the last look at the clock is does not belong to it.
    """
    usual_run, clock, ns = section.run, time.perf_counter_ns, 0

    def run() -> None:
        nonlocal ns
        begin = clock()
        usual_run()
        ns = round((1 + slowdown) * (clock() - begin))
        while clock() < begin + ns:
            pass

    return replace(section, run=run, reading=lambda: ns)


def install_callback(model: mujoco.MjModel, name: str) -> None:
    """Have every further step of this process call a function of the engine: a slower `mj_step`.

    MuJoCo calls `mjcb_control` in every step, after everything that follows from positions and
    velocities. Each of the FUNCTIONS then computes what no step reads, or what is there already, so
    the step ends in the same state, to the last bit. Threads that step call it as well, and none of
    them waits for Python.

    Raises:
      InputError: this release has no such function, or steps of the model call no callback.
      MachineError: the engine's library is not where the package has it.
    """
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        raise InputError(
            f"cannot call {name} inside a step: the model disables actuation, and with it callbacks"
        )
    try:
        function = _PROTOTYPE((name, engine_library()))
    except AttributeError:
        raise InputError(f"MuJoCo {mujoco.__version__} has no function {name}") from None
    mujoco.set_mjcb_control(function)
