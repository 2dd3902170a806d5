"""MuJoCo's functions that move a simulation, replaced in a program while it runs.

Programs call them as `mujoco.mj_step(…)`, so a replacement in the module `mujoco` reaches every
later call; a name bound earlier by `from mujoco import mj_step` stays as it is.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import mujoco

from mjbench.simulation.process_wide import ProcessWide

EngineFunction = Callable[..., Any]
# What makes the replacement from a function, by the function's name.
Wrappers = Mapping[str, Callable[[EngineFunction], EngineFunction]]
# Functions that compute a step or a part of one.
STEPPING = ("mj_step", "mj_step1", "mj_step2")


@contextlib.contextmanager
def replaced(wrappers: Wrappers) -> Iterator[None]:
    """Replace functions of `mujoco` while the block runs.

    Names that this release of MuJoCo does not have are skipped. Blocks may overlap without nesting,
    in any threads: a call then passes through the wrappers of each that runs. When the last one
    ends, the functions are those of before the first.
    """
    _WRAPPERS.begin(wrappers)
    try:
        yield
    finally:
        _WRAPPERS.end(wrappers)


def original(name: str) -> EngineFunction:
    """Return a function of `mujoco` as it is outside of all blocks."""
    function: EngineFunction = _ORIGINALS.get(name) or getattr(mujoco, name)
    return function


def _replace(active: Sequence[Wrappers]) -> None:
    names = {name for wrappers in active for name in wrappers if hasattr(mujoco, name)}
    for name in _ORIGINALS.keys() - names:
        setattr(mujoco, name, _ORIGINALS.pop(name))
    for name in names:
        function = _ORIGINALS.setdefault(name, original(name))
        for wrappers in active:
            function = wrappers[name](function) if name in wrappers else function
        setattr(mujoco, name, function)


_ORIGINALS: dict[str, EngineFunction] = {}  # of the functions that are replaced now
_WRAPPERS: ProcessWide[Wrappers] = ProcessWide(_replace)
