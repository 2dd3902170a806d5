"""Turn off the timer that MuJoCo's Python package installs; C programs step without one.

Since MuJoCo 3.3.1 the package sets `mjcb_time` in the C library: up to 3.13 whenever an MjData is
created and none is set, since 3.14 at `import mujoco`. A step then reads a clock around each of
its stages. Nothing that a step computes depends on it; only `mjData.timer` does.
"""

import ctypes
import functools
import os
import sys
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco

from mjbench.errors import MachineError, one_line, wrong_argument
from mjbench.simulation import compat
from mjbench.simulation.process_wide import ProcessWide

TIMER_NAME = "the timer of MuJoCo's Python package"
# Turns it off in a program that does not use mjbench, and what else that does.
OFF_CODE = "mujoco.mj_resetCallbacks()"
OFF_NOTE = (
    f"Call {OFF_CODE} after creating MjData. It removes callbacks of your own, too;"
    " mjbench.engine_clock(False) removes the timer alone. Steps compute the same; mjData.timer and"
    " the viewer's profiler stay blank."
)
OFF_SNIPPET = f"{OFF_CODE}  # after creating MjData; removes callbacks of your own, too"
# The share of a step, or the gain, from which on turning it off is advised.
MIN_GAIN = 0.03


class EngineClock:
    """A call of `engine_clock`; in a `with` statement, it holds until the end of the block."""

    def __init__(self, on: bool):
        self._call = _Switch(on, weakref.ref(self))
        self._begin()

    def __enter__(self) -> "EngineClock":
        if self._call not in _CALLS.active:
            self._begin()
        return self

    def __exit__(self, *exception: object) -> None:
        """Set the timer as the other calls have it; without others, as it was before them."""
        _CALLS.end(self._call)

    def _begin(self) -> None:
        # of the calls whose object is gone, and so can begin or end no block, the last one counts
        for call in [each for each in _CALLS.active if each.clock() is None][:-1]:
            _CALLS.end(call)
        _CALLS.begin(self._call)


def engine_clock(on: bool) -> EngineClock:
    """Turn the timer of MuJoCo's Python package on or off, for all models and threads.

    The package installs it since 3.3.1, and a step reads it around each stage; C and C++ programs
    do not pay for it. Steps compute the same with and without it, to the last bit. Without it,
    `mjData.timer` holds no times, and profilers that show them are blank.

    In a `with` statement, the call holds until the end of the block; otherwise until the next one:

        with mjbench.engine_clock(False):
            mujoco.mj_step(model, data, 1000)

    Blocks of different threads may overlap. The last call decides, of those whose block has not
    ended; after all blocks, the timer is as it was before them.

    Args:
      on: whether to have the timer that there was before the first call: the package's, or the one
        that the program has set by `mujoco.set_mjcb_time`; releases before 3.3.1 have none.

    Raises:
      InputError: it is neither True nor False.
      MachineError: the timer of this MuJoCo cannot be reached from Python.
    """
    if not isinstance(on, bool):
        raise wrong_argument("on", on, "True or False")
    return EngineClock(on)


def has_clock(model: mujoco.MjModel) -> bool:
    """Return whether steps read a timer that tells the time: since 3.3.1 the package's."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    is_counting = bool(data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration > 0)
    return is_counting and not _TIMER.is_off


class _Switch:
    def __init__(self, on: bool, clock: "weakref.ref[EngineClock]"):
        self.on, self.clock = on, clock


class _EngineTimer:
    """The variable `mjcb_time` of the C library, and what it was before it was turned off."""

    def __init__(self) -> None:
        self.is_off = False
        self._before: int | None = None

    def set(self, calls: Sequence[_Switch]) -> None:
        off = bool(calls) and not calls[-1].on
        if off == self.is_off:
            return
        variable, address = _mjcb_time(), _off_address()
        if off:
            self._before, variable.value = variable.value, address
        elif variable.value == address:  # otherwise the program has set another, which stays
            variable.value = self._before
        self.is_off = off


_TIMER = _EngineTimer()
_CALLS: ProcessWide[_Switch] = ProcessWide(_TIMER.set)


@functools.cache  # a timed block may ask for it
def engine_library() -> ctypes.CDLL:
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


@functools.cache  # a timed block may ask for it
def _mjcb_time() -> ctypes.c_void_p:
    try:
        return ctypes.c_void_p.in_dll(engine_library(), "mjcb_time")
    except ValueError as error:
        raise MachineError(f"MuJoCo's library has no mjcb_time: {one_line(error)}") from error


@functools.cache
def _off_address() -> int | None:
    """Return the address that turns the timer off: NULL, where a new MjData leaves that so.

    In releases that would install the timer again, it is libc's difftime, which takes no time. Its
    arguments are whatever two registers hold. It converts integers, so the result is never a
    denormal number, which would be slow.
    """
    if compat.timer_is_installed_at_import():
        return None
    try:
        library = ctypes.CDLL("ucrtbase.dll" if sys.platform == "win32" else None)
        name = "_difftime64" if sys.platform == "win32" else "difftime"
        function: Any = getattr(library, name)
    except (OSError, AttributeError) as error:
        raise MachineError("no C library to take the timer's function from") from error
    return ctypes.cast(function, ctypes.c_void_p).value
