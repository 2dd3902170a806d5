"""MuJoCo's functions that move a simulation, replaced in a program while it runs.

Programs call them as `mujoco.mj_step(…)`, so a replacement in the module `mujoco` reaches every
later call; a name bound earlier by `from mujoco import mj_step` stays as it is.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import mujoco

EngineFunction = Callable[..., Any]
# Functions that compute a step or a part of one.
STEPPING = ("mj_step", "mj_step1", "mj_step2")


@contextlib.contextmanager
def replaced(wrappers: Mapping[str, Callable[[EngineFunction], EngineFunction]]) -> Iterator[None]:
    """Replace functions of `mujoco` while the block runs.

    Args:
      wrappers: by the function's name, what makes the replacement from the function. Names that
        this release of MuJoCo does not have are skipped.
    """
    functions = {name: getattr(mujoco, name) for name in wrappers if hasattr(mujoco, name)}
    try:
        for name, function in functions.items():
            setattr(mujoco, name, wrappers[name](function))
        yield
    finally:
        for name, function in functions.items():
            setattr(mujoco, name, function)
