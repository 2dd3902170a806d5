"""MuJoCo's functions that move a simulation, replaced in a program while it runs.

Programs call them as `mujoco.mj_step(…)`, so a replacement in the module `mujoco` reaches every
later call. A name bound earlier by `from mujoco import mj_step` stays as it is, unless that is one
of the `bindings` that are replaced, too.
"""

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import mujoco

from mjbench.simulation.process_wide import ProcessWide

EngineFunction = Callable[..., Any]
# What makes the replacement from a function, by the function's name.
Wrappers = Mapping[str, Callable[[EngineFunction], EngineFunction]]
# Functions that compute a step or a part of one.
STEPPING = ("mj_step", "mj_step1", "mj_step2")
# Packages whose modules go on with MuJoCo's own functions.
_UNCHANGED = ("mujoco", "mjbench")


@dataclass(frozen=True, eq=False)
class Binding:
    """A name of a module that stands for `function` of `mujoco`."""

    module: ModuleType
    attribute: str
    function: str


def names() -> list[str]:
    """Return the names of all functions of the engine."""
    return [
        name for name in dir(mujoco) if name.startswith("mj_") and callable(getattr(mujoco, name))
    ]


def bindings() -> list[Binding]:
    """Return where modules other than `mujoco` hold functions of the engine now."""
    by_identity = {id(original(name)): name for name in names()}
    return [
        Binding(module, attribute, name)
        for module_name, module in list(sys.modules.items())
        if module_name.partition(".")[0] not in _UNCHANGED and isinstance(module, ModuleType)
        for attribute, value in list(vars(module).items())
        if (name := by_identity.get(id(value))) is not None
    ]


@contextlib.contextmanager
def replaced(wrappers: Wrappers, elsewhere: Sequence[Binding] = ()) -> Iterator[None]:
    """Replace functions of `mujoco`, and where they are held `elsewhere`, while the block runs.

    Names that this release of MuJoCo does not have are skipped. Blocks may overlap without nesting,
    in any threads: a call then passes through the wrappers of each that runs. When the last one
    ends, the functions are those of before the first.
    """
    before = [(each, getattr(each.module, each.attribute)) for each in elsewhere]
    _WRAPPERS.begin(wrappers)
    try:
        for each in elsewhere:
            setattr(each.module, each.attribute, getattr(mujoco, each.function))
        yield
    finally:
        for each, function in before:
            setattr(each.module, each.attribute, function)
        _WRAPPERS.end(wrappers)


def original(name: str) -> EngineFunction:
    """Return a function of `mujoco` as it is outside of all blocks."""
    function: EngineFunction = _ORIGINALS.get(name) or getattr(mujoco, name)
    return function


def _replace(active: Sequence[Wrappers]) -> None:
    wrapped = {name for wrappers in active for name in wrappers if hasattr(mujoco, name)}
    for name in _ORIGINALS.keys() - wrapped:
        setattr(mujoco, name, _ORIGINALS.pop(name))
    for name in wrapped:
        function = _ORIGINALS.setdefault(name, original(name))
        for wrappers in active:
            function = wrappers[name](function) if name in wrappers else function
        setattr(mujoco, name, function)


_ORIGINALS: dict[str, EngineFunction] = {}  # of the functions that are replaced now
_WRAPPERS: ProcessWide[Wrappers] = ProcessWide(_replace)
