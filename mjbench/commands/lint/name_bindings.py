"""Where the names of a script are bound, and which functions its calls mean.

Scopes are those of functions and of the module, as Python resolves names. A name that a `global` or
`nonlocal` statement mentions may be bound again anywhere.

A call means a function where its name is bound once, by a `def` without decorators; where it is
`self.method(…)` of a class that has one such method, or `env.method(…)` where one statement binds
`env = Env(…)`; or where its name runs over a tuple of such functions, as in
`for way in (by_copies, by_state)`. Other calls mean nothing that is known.
"""

import ast
import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from mjbench.commands.lint.script_syntax import (
    FUNCTIONS,
    ancestors,
    dotted_name,
    is_bound,
    parameters_of,
)

Scope = ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef


class NameBindings:
    """The bindings of all names of a script.

    Attributes:
      identifiers: all names in it, those of attributes and arguments included.
    """

    def __init__(self, tree: ast.Module, parents: Mapping[ast.AST, ast.AST]):
        self._parents = parents
        self._bindings: defaultdict[tuple[Scope, str], list[ast.AST]] = defaultdict(list)
        self._origins: defaultdict[str, set[str]] = defaultdict(set)
        self.declared: set[str] = set()
        self.identifiers: set[str] = set()
        for node in ast.walk(tree):
            self.identifiers.update(_identifiers(node))
            if isinstance(node, ast.Global | ast.Nonlocal):
                self.declared.update(node.names)
            for name in bound_by(node):
                self._origins[name].add(self._imported(node))
                for scope in self._scopes_of_binding(node):
                    self._bindings[scope, name].append(node)

    def scope_of(self, node: ast.AST) -> Scope:
        return next(self._scopes_around(node))

    def owner(self, name: str, node: ast.AST) -> Scope | None:
        """Return the scope whose name a node means by `name`; None where the script binds none."""
        innermost, *outer = self._scopes_around(node)
        seen = [innermost, *(scope for scope in outer if not isinstance(scope, ast.ClassDef))]
        return next((scope for scope in seen if (scope, name) in self._bindings), None)

    def bindings(self, name: str, scope: Scope) -> Sequence[ast.AST]:
        return self._bindings.get((scope, name), [])

    def of(self, name: str, node: ast.AST) -> Sequence[ast.AST]:
        """Return the nodes that bind what a name means where a node stands."""
        owner = self.owner(name, node)
        return self.bindings(name, owner) if owner is not None else ()

    def origin(self, dotted: str) -> str:
        """Return what a dotted name was imported as, such as `mujoco.mj_step`; empty if unknown."""
        root, _, rest = dotted.partition(".")
        origins = self._origins.get(root, set())
        if len(origins) != 1 or root in self.declared:
            return ""
        (origin,) = origins
        return ".".join(filter(None, (origin, rest))) if origin else ""

    def _imported(self, node: ast.AST) -> str:
        if not isinstance(node, ast.alias):
            return ""
        statement = self._parents[node]
        if isinstance(statement, ast.ImportFrom):
            return "" if statement.level else f"{statement.module}.{node.name}"
        return node.name if node.asname else node.name.partition(".")[0]

    def _scopes_of_binding(self, node: ast.AST) -> Iterator[Scope]:
        scopes = self._scopes_around(node)
        # in a default value, of the scope around the function
        is_walrus = isinstance(self._parents.get(node), ast.NamedExpr)
        return scopes if is_walrus else itertools.islice(scopes, 1)

    def _scopes_around(self, node: ast.AST) -> Iterator[Scope]:
        return (above for above in ancestors(self._parents, node) if isinstance(above, Scope))


@dataclass(frozen=True, eq=False)
class ScriptFunctions:
    """The functions of a script and their calls."""

    _bindings: NameBindings
    _parents: Mapping[ast.AST, ast.AST]
    _calls: Sequence[ast.Call]

    def called(self, node: ast.AST) -> Sequence[ast.FunctionDef]:
        """Return the functions that a call, or a property, may mean; none if they are unknown."""
        match node:
            case ast.Attribute():
                return self._method(node, ["property"])
            case ast.Call(func=ast.Attribute() as method):
                return self._method(method, [])
            case ast.Call(func=ast.Name() as name):
                functions = self._named(name, may_be_loop_variable=True)
                return functions or self._method(ast.Attribute(name, "__call__"), [])
        return []

    def named(self, node: ast.AST) -> ast.FunctionDef | None:
        """Return the function that a name stands for, as in `Thread(target=work)`."""
        functions = self._named(node) if isinstance(node, ast.Name) else ()
        return functions[0] if functions else None

    def calls_of(self, function: ast.FunctionDef) -> Sequence[ast.Call]:
        return self._calls_of.get(function, [])

    def arguments(self, call: ast.Call, function: ast.FunctionDef) -> Mapping[str, ast.expr] | None:
        """Return what a call gives to the parameters of a function; None if that is not plain."""
        parameters = parameters_of(function)
        if isinstance(call.func, ast.Attribute):
            parameters = parameters[1:]
        starred = any(isinstance(argument, ast.Starred) for argument in call.args)
        if starred or len(call.args) > len(parameters) or any(k.arg is None for k in call.keywords):
            return None
        by_name = {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg}
        return {**dict(zip(parameters, call.args, strict=False)), **by_name}

    def receiving(
        self, call: ast.Call, argument: ast.expr
    ) -> Iterator[tuple[ast.FunctionDef, Sequence[str]]]:
        """Yield the functions that a call may mean, with the parameters that get an argument."""
        for function in self.called(call):
            given = self.arguments(call, function) or {}
            yield function, [name for name, value in given.items() if value is argument]

    @cached_property
    def _calls_of(self) -> Mapping[ast.FunctionDef, list[ast.Call]]:
        calls: defaultdict[ast.FunctionDef, list[ast.Call]] = defaultdict(list)
        for call in self._calls:
            for function in self.called(call):
                calls[function].append(call)
        return calls

    def _named(
        self, name: ast.Name, may_be_loop_variable: bool = False
    ) -> Sequence[ast.FunctionDef]:
        binding = self._binding(name)
        if isinstance(binding, ast.FunctionDef):
            return () if binding.decorator_list else (binding,)
        loop = self._parents.get(binding) if binding is not None else None
        if may_be_loop_variable and isinstance(loop, ast.For) and loop.target is binding:
            choices = loop.iter.elts if isinstance(loop.iter, ast.Tuple | ast.List) else []
            functions = [self.named(choice) for choice in choices]
            return [each for each in functions if each is not None] if all(functions) else ()
        return ()

    def _method(
        self, attribute: ast.Attribute, decorators: Sequence[str]
    ) -> Sequence[ast.FunctionDef]:
        owner = self._class_of(attribute.value)
        body = owner.body if owner is not None else []
        methods = [n for n in body if isinstance(n, FUNCTIONS) and n.name == attribute.attr]
        if [[*map(dotted_name, method.decorator_list)] for method in methods] != [decorators]:
            return []
        return [method for method in methods if isinstance(method, ast.FunctionDef)]

    def _class_of(self, node: ast.AST) -> ast.ClassDef | None:
        if not isinstance(node, ast.Name):
            return None
        if node.id == "self":
            above = ancestors(self._parents, node)
            return next((each for each in above if isinstance(each, ast.ClassDef)), None)
        match self._parents.get(self._binding(node) or node):
            case ast.Assign(value=ast.Call(func=ast.Name() as created)):
                owner = self._binding(created)
                return owner if isinstance(owner, ast.ClassDef) else None
        return None

    def _binding(self, name: ast.Name) -> ast.AST | None:
        bindings = self._bindings.of(name.id, name)
        return bindings[0] if len(bindings) == 1 else None


def _identifiers(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Global | ast.Nonlocal):
        yield from node.names
    elif not isinstance(node, ast.Constant):
        for _, value in ast.iter_fields(node):
            if isinstance(value, str):
                yield from value.split(".")


def bound_by(node: ast.AST) -> tuple[str, ...]:
    """Return the names that a node binds or deletes, without those of the nodes below it."""
    if isinstance(node, ast.Name):
        return (node.id,) if is_bound(node) else ()
    if isinstance(node, ast.alias):
        return (node.asname or node.name.partition(".")[0],)
    if isinstance(node, ast.arg):
        return (node.arg,)
    # functions, classes, handlers of exceptions, patterns and type parameters
    name = getattr(node, "rest" if isinstance(node, ast.MatchMapping) else "name", None)
    return (name,) if isinstance(name, str) else ()
