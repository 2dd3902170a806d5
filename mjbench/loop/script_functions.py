"""Which functions of a script its calls mean, and which argument becomes which parameter.

A call means a function where its name is bound once, by a `def` without decorators; where it is
`self.method(…)` of a class that has one such method, or `env.method(…)` where one statement binds
`env = Env(…)`; or where its name runs over a tuple of such functions, as in
`for way in (by_copies, by_state)`. Other calls mean nothing that is known.
"""

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from mjbench.loop.name_bindings import NameBindings
from mjbench.loop.script_syntax import FUNCTIONS, ancestors, dotted_name, parameters_of


@dataclass(frozen=True, eq=False)
class ScriptFunctions:
    """The functions of a script and their calls."""

    _bindings: NameBindings
    _parents: Mapping[ast.AST, ast.AST]
    _calls: Sequence[ast.Call]

    def called(self, node: ast.AST) -> Sequence[ast.FunctionDef]:
        """Return the functions that a call, or a property, may mean; none if they are unknown."""
        if isinstance(node, ast.Attribute):
            return self._method(node, ["property"])
        if not isinstance(node, ast.Call):
            return []
        if isinstance(node.func, ast.Name):
            return self._named(node.func, may_be_loop_variable=True)
        return self._method(node.func, []) if isinstance(node.func, ast.Attribute) else []

    def named(self, node: ast.AST) -> ast.FunctionDef | None:
        """Return the function that a name stands for, as in `Thread(target=work)`."""
        functions = self._named(node) if isinstance(node, ast.Name) else ()
        return functions[0] if functions else None

    def calls_of(self, function: ast.FunctionDef) -> Sequence[ast.Call]:
        """Return the calls that may mean a function."""
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
            known = [function for function in functions if function is not None]
            return known if len(known) == len(functions) else ()
        return ()

    def _method(
        self, attribute: ast.Attribute, decorators: Sequence[str]
    ) -> Sequence[ast.FunctionDef]:
        """Return the one method of a name, if it has just these decorators."""
        owner = self._class_of(attribute.value)
        body = owner.body if owner is not None else []
        methods = [n for n in body if isinstance(n, FUNCTIONS) and n.name == attribute.attr]
        named = [[dotted_name(d) for d in method.decorator_list] for method in methods]
        if named != [decorators]:
            return []
        return [method for method in methods if isinstance(method, ast.FunctionDef)]

    def _class_of(self, node: ast.AST) -> ast.ClassDef | None:
        """Return the class of the script that a name is an object of; None if unknown."""
        if not isinstance(node, ast.Name):
            return None
        if node.id == "self":
            above = ancestors(self._parents, node)
            return next((each for each in above if isinstance(each, ast.ClassDef)), None)
        assigned = self._parents.get(self._binding(node) or node)
        if not isinstance(assigned, ast.Assign) or not isinstance(assigned.value, ast.Call):
            return None
        created = assigned.value.func
        owner = self._binding(created) if isinstance(created, ast.Name) else None
        return owner if isinstance(owner, ast.ClassDef) else None

    def _binding(self, name: ast.Name) -> ast.AST | None:
        """Return the one node that binds a name; None where there are others."""
        bindings = self._bindings.of_name(name)
        return bindings[0] if len(bindings) == 1 else None
