"""How functions of the user's modules are replaced, once a module is imported.

What goes wrong in the clocks does not reach the program; what its signal handlers raise does.
"""

import contextlib
import importlib
import importlib.abc
import importlib.machinery
import sys
from collections.abc import Callable
from types import MethodType, ModuleType, TracebackType
from typing import Any


class suppress(contextlib.suppress):  # noqa: N801 - as that of Python
    """Suppress errors of the block, but none of a signal handler that runs meanwhile.

    Python runs handlers of the program between any two instructions, and those of an alarm may
    raise TimeoutError, for example.
    """

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        frames: TracebackType | None,
    ) -> bool:
        return super().__exit__(kind, error, frames) and not is_of_signal(frames)


def is_of_signal(frames: TracebackType | None) -> bool:
    """Return whether an error comes from a signal handler of the program."""
    import signal

    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    codes = [_code_of(handler) for handler in handlers if callable(handler)]
    while frames is not None:
        if frames.tb_frame.f_code in codes:
            return True
        frames = frames.tb_next
    return False


def _code_of(handler: Any) -> Any:
    function = getattr(handler, "func", handler)  # of `functools.partial`
    return getattr(function, "__code__", getattr(type(function).__call__, "__code__", None))


def named_like(function: Any, replacement: Any) -> Any:
    for name in ("__name__", "__qualname__", "__doc__", "__module__"):
        value = getattr(function, name, None)
        if value is not None:
            setattr(replacement, name, value)
    replacement.__wrapped__ = function
    return replacement


class _MuJoCo:
    """What replacements are methods of; other processes that read one have their own instead."""

    def __reduce__(self) -> tuple[Callable[[str], ModuleType], tuple[str]]:
        """Return how to get the module `mujoco`, which has the replacement as an attribute."""
        return importlib.import_module, ("mujoco",)

    def __getattr__(self, name: str) -> Any:
        """Return what `mujoco` has, as a copy of a method asks for it."""
        return getattr(sys.modules["mujoco"], name)

    def __repr__(self) -> str:
        return "mujoco"


def engine_function(call: Any, function: Any) -> Any:
    """Return what stands for a function of the engine; `call` has one more argument, the first.

    It is a method that has its object already, so it does not become one of a class that has it as
    an attribute, as the engine's function does not. To call an object of a class of our own would
    take half as long again.
    """
    named_like(function, call)
    return MethodType(call, _MuJoCo())


class AfterImport(importlib.abc.MetaPathFinder):
    """Calls a function with a module of a certain name, once that was imported."""

    def __init__(self, actions: dict[str, Callable[[ModuleType], None]]) -> None:
        self._actions = actions

    def find_spec(
        self, fullname: str, path: Any, target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return another finder's module, whose loader calls the function afterwards."""
        if fullname not in self._actions:
            return None
        for finder in sys.meta_path:
            if finder is self or not hasattr(finder, "find_spec"):
                continue
            spec = finder.find_spec(fullname, path, target)
            if spec is not None:
                _call_after(spec, fullname, self._actions)
                return spec
        return None


def _call_after(
    spec: importlib.machinery.ModuleSpec,
    name: str,
    actions: dict[str, Callable[[ModuleType], None]],
) -> None:
    loader = spec.loader
    execute = getattr(loader, "exec_module", None)
    if execute is None:
        return

    def exec_module(module: ModuleType) -> None:
        execute(module)
        action = actions.pop(name, None)  # only once: a module may be looked for without import
        try:
            if action is not None:
                action(module)
        except Exception as error:
            if is_of_signal(error.__traceback__):
                raise
            reason = str(error)
            if isinstance(error, AttributeError) and error.obj is module:  # of the same name
                reason = f"{module.__file__} has no {error.name}"
            print(f"mjbench: calls of {name} are not timed: {reason}", file=sys.stderr)

    try:
        loader.exec_module = exec_module  # type: ignore[union-attr, method-assign]
    except AttributeError:  # a loader that takes no attributes
        return
