"""Replace MuJoCo's functions wherever a running program holds them.

`mujoco.mj_step` finds a replacement in the module `mujoco`. A name bound by `from mujoco import
mj_step` does not, so every module that holds one of the functions is given the replacement, too.
"""

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

import mujoco

from mjbench.simulation import engine_functions
from mjbench.simulation.engine_functions import EngineFunction

# Packages whose modules go on with MuJoCo's own functions.
_UNCHANGED = ("mujoco", "mjbench")


@dataclass(frozen=True, eq=False)
class Binding:
    """A name of a module that stands for `function` of `mujoco`."""

    module: ModuleType
    attribute: str
    function: str


def function_names() -> list[str]:
    return [
        name for name in dir(mujoco) if name.startswith("mj_") and callable(getattr(mujoco, name))
    ]


def bindings() -> list[Binding]:
    """Return where modules other than `mujoco` hold functions of the engine now."""
    by_identity = {id(getattr(mujoco, name)): name for name in function_names()}
    held = []
    for module_name, module in list(sys.modules.items()):
        if module_name.partition(".")[0] in _UNCHANGED or not isinstance(module, ModuleType):
            continue
        for attribute, value in list(vars(module).items()):
            if (name := by_identity.get(id(value))) is not None:
                held.append(Binding(module, attribute, name))
    return held


@contextlib.contextmanager
def replaced(
    wrappers: Mapping[str, Callable[[EngineFunction], EngineFunction]],
    elsewhere: Sequence[Binding] = (),
) -> Iterator[None]:
    before = [(each, getattr(each.module, each.attribute)) for each in elsewhere]
    with engine_functions.replaced(wrappers):
        try:
            for binding in elsewhere:
                replacement = getattr(mujoco, binding.function)
                setattr(binding.module, binding.attribute, replacement)
            yield
        finally:
            for binding, function in before:
                setattr(binding.module, binding.attribute, function)
