"""Turn the engine's clock off: since MuJoCo 3.3.1 a step reads it around every stage.

Nothing that a step computes depends on it; only `mjData.timer` does. It is turned off by a C
function in its place (`mjcb_time`) that returns at once, on any thread and without Python.
"""

import ctypes
import functools
import sys
from typing import Any

import mujoco

from mjbench.errors import MachineError
from mjbench.simulation import compat

# double f(void): the type of mjcb_time.
_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_double)


class EngineClock:
    """The engine's clock as it was set, and how to set it back; use it in a `with` statement."""

    def __init__(self, previous: Any):
        """Remember the callback that was installed before."""
        self._previous = previous

    def __enter__(self) -> "EngineClock":
        """Leave the clock as it was set."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Set the clock back as it was before."""
        mujoco.set_mjcb_time(self._previous)


def engine_clock(on: bool) -> EngineClock:
    """Turn the engine's clock on or off, for all models and threads of this process.

    Steps compute the same with and without it, to the last bit. Without it, `mjData.timer` holds no
    times. In a `with` statement, the clock is set back at the end:

        with mjbench.engine_clock(False):
            mujoco.mj_step(model, data, 1000)

    Releases before 3.3.1 have no clock of their own. Some later ones do not get theirs back: there,
    `engine_clock(True)` and the end of a `with` statement leave it off.

    Args:
      on: whether to have a clock: the engine's own.

    Raises:
      MachineError: there is no C function to take the clock's place on this system.
    """
    previous = mujoco.get_mjcb_time()
    mujoco.set_mjcb_time(None if on else _no_clock())
    return EngineClock(previous)


def can_be_switched(model: mujoco.MjModel) -> bool:
    """Return whether the engine has a clock here that can be turned off and on again.

    It is turned off and on to see; some releases do not get theirs back.
    """
    if not compat.has_clock(model):
        return False
    with engine_clock(False):
        pass
    return compat.has_clock(model)


@functools.cache  # a timed block may call it
def _no_clock() -> Any:
    """Return a C function that takes no time.

    It is libc's difftime: its arguments are whatever two registers hold, and nobody reads its
    result. It converts integers, so the result is never a denormal number, which would be slow.
    """
    try:
        library = ctypes.CDLL("ucrtbase.dll" if sys.platform == "win32" else None)
        name = "_difftime64" if sys.platform == "win32" else "difftime"
        return ctypes.cast(getattr(library, name), _PROTOTYPE)
    except (OSError, AttributeError) as error:
        raise MachineError("no C library to take the clock's function from") from error
