"""The functions that an environment's step calls, found in its source.

A step is read with those it overrides and calls by `super().step(…)`. Functions that it calls are
methods of the environment or of what it holds (`self.sim.step()`), and functions of its module.
Functions that those call are included if their name says which layer they belong to.
"""

import ast
import functools
import inspect
import sys
import textwrap
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.commands.env.layers import Layer, layer_of
from mjbench.commands.lint.script_syntax import dotted_name, is_call

# Layers whose functions' own callees are timed, too; other functions include what they call.
_ENTERED = {Layer.STEPPING, Layer.ACTION, Layer.INFO, Layer.TERMINATION, Layer.REST}


@dataclass(frozen=True, eq=False)
class Callee:
    """A function that a step calls; `name` is for people: of a wrapper, its class."""

    owner: Any
    attribute: str
    layer: Layer
    name: str


@dataclass(frozen=True)
class _Call:
    """A call of a method by the names after `self`, such as `("sim", "step")`, or of a function."""

    path: tuple[str, ...]
    is_own: bool
    results: tuple[str, ...]


def find(environment: object) -> list[Callee]:
    """Return the functions that an innermost environment's step calls, each once, until a reset."""
    callees: dict[tuple[int, str], Callee] = {}
    for function in _steps(environment):
        for callee in _callees_of(environment, function):
            callees.setdefault((id(callee.owner), callee.attribute), callee)
            if callee.layer in _ENTERED and not isinstance(callee.owner, types.ModuleType):
                for inner in _known_callees(callee):
                    callees.setdefault((id(inner.owner), inner.attribute), inner)
    callees.pop((id(environment), "step"), None)
    return list(callees.values())


def builds_info(environment: object) -> bool:
    for function in _steps(environment):
        tree = _tree(function)
        for node in ast.walk(tree) if tree else ():
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict):
                names = [name for target in node.targets for name in _names(target)]
                if layer_of("", names) == Layer.INFO:
                    return True
    return False


def _known_callees(callee: Callee) -> Iterator[Callee]:
    """Yield what a method calls on its own object that belongs to a layer by its name."""
    method = inspect.getattr_static(type(callee.owner), callee.attribute, None)
    if not isinstance(method, types.FunctionType):
        return
    for inner in _callees_of(callee.owner, _undecorated(method)):
        if inner.owner is callee.owner and layer_of(inner.attribute) != Layer.REST:
            yield inner


def _steps(environment: object) -> Iterator[Callable[..., Any]]:
    own = vars(environment).get("step") if hasattr(environment, "__dict__") else None
    if isinstance(own, types.FunctionType):
        yield own
    for each in type(environment).__mro__:
        step = vars(each).get("step")
        if not isinstance(step, types.FunctionType):
            continue
        step = _undecorated(step)
        yield step
        if not _calls_base_step(step):
            return


def _undecorated(function: types.FunctionType) -> types.FunctionType:
    """Return the function inside its decorators, also those that do not say what they wrap."""
    function = inspect.unwrap(function)
    for cell in function.__closure__ or ():
        try:
            content = cell.cell_contents
        except ValueError:  # empty
            continue
        if isinstance(content, types.FunctionType) and "self" in content.__code__.co_varnames[:1]:
            return _undecorated(content)
    return function


def _callees_of(owner: object, function: Callable[..., Any]) -> Iterator[Callee]:
    for call in _calls(function):
        target = _owner(owner, function, call)
        if target is not None and _can_be_replaced(target, call.path[-1]):
            name = call.path[-1]
            yield Callee(target, name, layer_of(name, call.results), name)


def _owner(owner: object, function: Callable[..., Any], call: _Call) -> Any:
    """Return what has the function of a call; None where nothing does now."""
    if not call.is_own:
        module = sys.modules.get(function.__module__)
        is_home = module is not None and vars(module) is getattr(function, "__globals__", None)
        return module if is_home else None
    target: Any = owner
    for name in call.path[:-1]:
        try:
            target = getattr(target, name)
        except Exception:  # a property of the user's may raise anything
            return None
    return target


def _can_be_replaced(owner: object, attribute: str) -> bool:
    if isinstance(owner, types.ModuleType):
        return isinstance(vars(owner).get(attribute), types.FunctionType)
    if not hasattr(owner, "__dict__") or isinstance(owner, type):
        return False
    own = vars(owner).get(attribute)
    if own is not None:
        return isinstance(own, types.FunctionType | types.MethodType)
    return isinstance(
        inspect.getattr_static(type(owner), attribute, None),
        types.FunctionType | classmethod | staticmethod,
    )


@functools.lru_cache(maxsize=256)
def _calls(function: Callable[..., Any]) -> Sequence[_Call]:
    """Return the calls in a function's source; none where it has no source."""
    tree = _tree(function)
    if tree is None or not tree.args.args:
        return ()
    own = tree.args.args[0].arg
    results = _results(tree)
    calls = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = dotted_name(node.func)
        first, *path = name.split(".")
        is_own = bool(path) and first == own
        if is_own or (name and not path):
            calls.append(_Call(tuple(path) or (name,), is_own, results.get(node, ())))
    return tuple(calls)


def _tree(function: Callable[..., Any]) -> ast.FunctionDef | None:
    try:
        module = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError, ValueError):
        return None
    first = module.body[0] if module.body else None
    return first if isinstance(first, ast.FunctionDef) else None


def _results(tree: ast.AST) -> dict[ast.Call, tuple[str, ...]]:
    """Return the names that the result of each call is assigned to, alone or in an expression."""
    names: dict[ast.Call, tuple[str, ...]] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign) and node.value:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            assigned = tuple(name for target in targets for name in _names(target))
            calls = (each for each in ast.walk(node.value) if isinstance(each, ast.Call))
            names.update(dict.fromkeys(calls, assigned))
    return names


def _names(target: ast.expr) -> list[str]:
    """Return the names of what is assigned to; of `self.info["a"]` it is `info`."""
    match target:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return [name]
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return [name for part in parts for name in _names(part)]
        case ast.Subscript(value=value) | ast.Starred(value=value):
            return _names(value)
    return []


def _calls_base_step(function: Callable[..., Any]) -> bool:
    tree = _tree(function)
    return any(
        isinstance(node, ast.Attribute) and node.attr == "step" and is_call(node.value, "super")
        for node in (ast.walk(tree) if tree else ())
    )
