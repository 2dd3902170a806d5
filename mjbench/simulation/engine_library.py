"""The C library of MuJoCo that this process has loaded, for what Python does not offer."""

import ctypes
import functools
import os
import sys
from pathlib import Path

from mjbench.errors import MachineError, one_line


@functools.cache  # a timed block may ask for it
def loaded() -> ctypes.CDLL:
    """Return the library whose functions and variables `mujoco` uses.

    Raises:
      MachineError: it is not loaded from where the package has it.
    """
    from mujoco import _functions

    # The library is not everywhere beside the extension modules, but they find its symbols.
    file = _functions.__file__
    if sys.platform == "win32":
        file = str(Path(file).with_name("mujoco.dll"))
    try:
        return ctypes.CDLL(file, mode=getattr(os, "RTLD_NOLOAD", ctypes.DEFAULT_MODE))
    except OSError as error:
        raise MachineError(f"{file} is not loaded: {one_line(error)}") from error
