"""What a script does with one MjData: which fields it names, which engine functions get it.

An MjData is followed through names alone: where it is assigned, and into and out of the functions
of the same file that get it. Anything else, such as an attribute, a list or a class of another
package, is a use that is not known.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field

from mjbench.commands.lint.name_bindings import Scope
from mjbench.commands.lint.script_syntax import (
    COPIES,
    creates_container,
    is_bound,
    is_call,
    is_numpy_call,
    last_name,
)
from mjbench.commands.lint.stepping_script import (
    FIELDS,
    PART_PREFIXES,
    STORING_METHODS,
    VIEW_METHODS,
    SteppingScript,
    index_gives_view,
)


@dataclass
class DataUses:
    """What a script does with an MjData.

    Attributes:
      fields: that it names, those of named parts by the name of the whole array.
      functions: of the engine that get it, and `copy` and `deepcopy`.
      outlives: whether a view of it is stored, named or returned, and so keeps its memory.
    """

    fields: set[str] = field(default_factory=set)
    functions: set[str] = field(default_factory=set)
    outlives: bool = False


def uses_of(script: SteppingScript, node: ast.Name, with_callers: bool = True) -> DataUses | None:
    """Return what a script does with an MjData, callers too if asked; None if more may happen."""
    owner = script.bindings.owner(node.id, node)
    return _Following(script, with_callers).follow(owner, node.id) if owner is not None else None


def uses_of_parameter(
    script: SteppingScript, function: ast.FunctionDef, parameter: str
) -> DataUses | None:
    """Return what a function does with the MjData that it gets; None if more may happen to it."""
    return _Following(script, with_callers=False).follow(function, parameter)


class _UnknownUseError(Exception):
    """Anything may happen to the MjData."""


class _Following:
    def __init__(self, script: SteppingScript, with_callers: bool):
        self._script = script
        self._with_callers = with_callers
        self._uses = DataUses()

    def follow(self, scope: Scope, name: str) -> DataUses | None:
        waiting, followed = [(scope, name)], set()
        try:
            while waiting:
                place = waiting.pop()
                if place not in followed:
                    followed.add(place)
                    waiting += self._from(*place)
        except _UnknownUseError:
            return None
        return self._uses

    def _from(self, scope: Scope, name: str) -> Iterator[tuple[Scope, str]]:
        """Count the uses of a name, and yield the other names of the same MjData."""
        bindings = self._script.bindings
        if name in bindings.declared:
            raise _UnknownUseError
        for binding in bindings.bindings(name, scope):
            yield from self._of_binding(binding, scope)
        for node in self._reads(name, scope):
            yield from self._of_use(node)

    def _reads(self, name: str, scope: Scope | None) -> Iterator[ast.Name]:
        for node in self._script.names.get(name, []):
            is_read = isinstance(node.ctx, ast.Load)
            if is_read and self._script.bindings.owner(name, node) is scope:
                yield node

    def _of_binding(self, binding: ast.AST, scope: Scope) -> Iterator[tuple[Scope, str]]:
        value = self._script.values.get(binding)
        is_fresh = is_call(value, "MjData", *COPIES)
        if isinstance(value, ast.Name) and self._with_callers:
            yield from self._place(value)
        elif isinstance(binding, ast.arg) and isinstance(scope, ast.FunctionDef):
            if self._with_callers:
                yield from self._in_callers(scope, binding.arg)
        elif not is_fresh and not isinstance(getattr(binding, "ctx", None), ast.Del):
            raise _UnknownUseError

    def _in_callers(self, function: ast.FunctionDef, parameter: str) -> Iterator[tuple[Scope, str]]:
        functions = self._script.functions
        calls = functions.calls_of(function)
        named = self._script.names.get(function.name, [])
        references = [name for name in named if isinstance(name.ctx, ast.Load)]
        if not calls or len(references) != len(calls):  # also called from elsewhere
            raise _UnknownUseError
        for call in calls:
            argument = (functions.arguments(call, function) or {}).get(parameter)
            if isinstance(argument, ast.Name):
                yield from self._place(argument)
            elif not is_call(argument, *COPIES):
                raise _UnknownUseError

    def _place(self, name: ast.Name) -> Iterator[tuple[Scope, str]]:
        owner = self._script.bindings.owner(name.id, name)
        if owner is None:
            raise _UnknownUseError
        yield owner, name.id

    def _of_use(self, node: ast.Name) -> Iterator[tuple[Scope, str]]:
        parent = self._script.parents[node]
        above = self._script.parents.get(parent)
        if isinstance(parent, ast.keyword) and isinstance(above, ast.Call):
            yield from self._given(node, above)
        elif isinstance(parent, ast.Call) and node in parent.args:
            yield from self._given(node, parent)
        elif not isinstance(parent, ast.Attribute):
            yield from self._place(_only_target(parent))
        elif isinstance(above, ast.Call) and above.func is parent:
            self._of_part(above, parent.attr)
        else:
            self._read(parent)

    def _given(self, node: ast.Name, call: ast.Call) -> Iterator[tuple[Scope, str]]:
        name = last_name(call.func)
        if name.startswith("mj_") or name in COPIES:
            self._uses.functions.add(name)
            return
        receiving = list(self._script.functions.receiving(call, node))
        if not receiving or not all(parameters for _, parameters in receiving):
            raise _UnknownUseError
        for function, parameters in receiving:
            yield from ((function, parameter) for parameter in parameters)

    def _of_part(self, call: ast.Call, accessor: str) -> None:
        if accessor not in PART_PREFIXES or accessor == "sensor":
            raise _UnknownUseError
        parent = self._script.parents.get(call)
        parts = [parent]
        if not isinstance(parent, ast.Attribute):
            target = _only_target(parent)
            owner = self._script.bindings.owner(target.id, target)
            parts = [self._script.parents[node] for node in self._reads(target.id, owner)]
        for part in parts:
            if not isinstance(part, ast.Attribute):
                raise _UnknownUseError
            if part.attr not in ("id", "name"):
                self._read(part, PART_PREFIXES[accessor], is_row=True)

    def _read(self, read: ast.Attribute, prefix: str = "", is_row: bool = False) -> None:
        self._uses.fields.add(prefix + read.attr)
        self._uses.outlives |= _outlives(self._script, read, is_row)


def _only_target(statement: ast.AST | None) -> ast.Name:
    match statement:
        case ast.Assign(targets=[ast.Name() as target]):
            return target
    raise _UnknownUseError


def _outlives(script: SteppingScript, field: ast.Attribute, is_row: bool) -> bool:
    """Return whether a view of a field, such as `data.xpos`, outlives its expression."""
    if not FIELDS.match(field.attr):
        return False
    node: ast.expr = field
    while isinstance(parent := script.parents[node], ast.Subscript | ast.Attribute):
        above = script.parents.get(parent)
        if isinstance(parent, ast.Subscript) and parent.value is node:
            if not index_gives_view(parent, is_row):
                return False
            node = parent
        elif isinstance(parent, ast.Attribute):
            if not (isinstance(above, ast.Call) and parent.attr in VIEW_METHODS):
                return False
            node = above
        else:  # it is an index
            break
    if is_bound(node):
        return False
    match parent:
        case ast.Assign(targets=targets):
            return not all(
                isinstance(target, ast.Subscript)
                # an array copies what is put in
                and not any(map(creates_container, script.assigned(target.value)))
                for target in targets
            )
        case ast.Call(func=ast.Attribute() as function):
            return not is_numpy_call(parent) and last_name(function) in STORING_METHODS
    containers = ast.Return | ast.Yield | ast.Tuple | ast.List | ast.Dict | ast.keyword
    return isinstance(parent, containers | ast.ListComp | ast.GeneratorExp | ast.DictComp)
