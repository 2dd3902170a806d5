"""Which stored views can get `.copy()`, and why others cannot.

A copy changes nothing but what a log shows if

- the log is a list or a dict that one statement binds, empty, outside the loop that steps, to a
  name of the same function or of the module;
- every iteration of the loop stores the view there, by `log.append(data.qpos)` or
  `log[i] = data.qpos`, of what is certainly one MjData;
- all else that the script does with that name is to read and copy the values, after the loop, or to
  print, save, count or clear them.
"""

import ast

from mjbench.loop.lint_certain_names import DATA, CertainNames
from mjbench.loop.script_syntax import dotted_name, is_call, is_periodic, name_nodes
from mjbench.loop.stepping_script import Loop
from mjbench.loop.stored_views import store_of, stored_views

# Functions that return or write copies of all values; those that compute with them; built-in ones.
_SAVING = {"numpy.save", "numpy.savetxt", "numpy.savez", "numpy.savez_compressed", "pickle.dump"}
_READING = {
    f"numpy.{function}"
    for function in (
        *("array", "concatenate", "hstack", "max", "mean", "median", "min", "stack", "std", "sum"),
        *("var", "vstack"),
    )
}
_SHOWING = {"len", "print", "repr", "str"}


class Copying:
    """What is known of a script for copying views."""

    def __init__(self, names: CertainNames):
        self._names = names
        self._script = names.script
        self._bindings = names.bindings
        self._parents = names.script.parents
        self._stored = stored_views(names.script)

    def refusal(self, view: ast.expr) -> str:
        """Return why a view that a loop stores cannot be copied there; empty if it can."""
        body = self._stored.loop_around(view)
        above = self._script.above(view)
        containers = ast.Tuple | ast.List | ast.Dict
        log = self._stored_in(next(n for n in above if not isinstance(n, containers)))
        if body is None or log is None or not isinstance(body.node, Loop):
            return "only what is appended, or assigned to a key of a dict, of a name is copied"
        loop = body.node
        return (
            self._passing(view, loop)
            or self._binding(log, loop)
            or self._use(log, view, loop)
            or self._variation(view, loop)
        )

    def _stored_in(self, node: ast.AST | None) -> ast.Name | None:
        """Return the name in which a node stores something; None for other places."""
        store = store_of(node) if node is not None else None
        if node is None or store is None or not isinstance(store.place, ast.Name):
            return None
        is_statement = isinstance(node, ast.stmt) or isinstance(self._parents[node], ast.Expr)
        return store.place if is_statement and len(store.values) == 1 else None

    def _passing(self, view: ast.expr, loop: Loop) -> str:
        """Return why not every iteration of a loop stores a view, or not one in so many."""
        child: ast.AST = view
        for node in self._script.above(view):
            if isinstance(child, ast.stmt):
                is_regular = isinstance(node, ast.If) and is_periodic(node.test)
                is_certain = is_regular or node is loop or isinstance(node, ast.For | ast.With)
                if not is_certain or child not in node.body:  # type: ignore[attr-defined]
                    return "not every step stores it"
            if node is loop:
                break
            child = node
        return ""

    def _binding(self, log: ast.Name, loop: Loop) -> str:
        """Return why a name may not be that of a log alone; empty if it is."""
        name, scope = log.id, self._bindings.scope_of(loop)
        if isinstance(scope, ast.ClassDef) or self._bindings.owner(name, log) is not scope:
            return f"{name} is not of the same function as the loop"
        if name in self._bindings.declared or self._bindings.reaches_names:
            return f"a global statement, setattr, globals or the like could reach {name}"
        nodes = self._bindings.bindings(name, scope)
        values = self._script.assigned(log)
        around = set(self._script.above(nodes[0]))
        if len(nodes) > 1 or not self._is_empty(values[0]) or loop in around:
            return f"{name} is not certain to be a list or a dict that is empty before the loop"
        return f"a command of IPython names {name}" if self._names.is_in_command(name) else ""

    def _is_empty(self, value: ast.AST | None) -> bool:
        """Return whether an expression makes an empty list or dict, or a deque of several."""
        match value:
            case ast.List(elts=[]) | ast.Dict(keys=[]):
                return True
            case ast.Call(func=function, args=[], keywords=keywords):
                name = dotted_name(function)
                if name in ("list", "dict") and self._bindings.owner(name, value) is None:
                    return not keywords
                lengths = [getattr(keyword.value, "value", None) for keyword in keywords]
                is_long = all(isinstance(length, int) and length > 1 for length in lengths)
                return self._bindings.origin(name) == "collections.deque" and is_long
        return False

    def _use(self, log: ast.Name, view: ast.expr, loop: Loop) -> str:
        """Return where a log may be used for more than to store, or to read and copy."""
        scope = self._bindings.scope_of(loop)
        is_list_of_views = isinstance(self._parents[view], ast.Call)  # `log.append(data.qpos)`
        for node in name_nodes(scope):
            if node.id != log.id or isinstance(node.ctx, ast.Store):
                continue
            if self._bindings.owner(log.id, node) is not scope:
                continue
            is_store = self._stored_in(self._parents.get(self._parents[node])) is node
            if is_store or self._shows(node):
                continue
            around = self._stored.loop_around(node)  # that it runs after, or in another episode
            is_of_episode = around is None or around.node in self._script.above(loop)
            is_after = is_of_episode and self._bindings.scope_of(node) is scope
            if not (is_list_of_views and is_after and self._reads(node)):
                place = self._names.program.line_of(node).place
                return f"{place} may do more with {log.id} than read and copy it"
        return ""

    def _shows(self, log: ast.Name) -> bool:
        above = self._parents[log]
        if isinstance(above, ast.keyword):
            above = self._parents[above]
        match above:
            case ast.FormattedValue():
                return True
            case ast.Attribute(attr=attribute):
                return attribute == "clear" and isinstance(self._parents[above], ast.Call)
            case ast.Call(func=function) if function is not log:
                name = dotted_name(function)
                is_built_in = name in _SHOWING and self._bindings.owner(name, above) is None
                return is_built_in or self._bindings.origin(name) in _SAVING
        return False

    def _reads(self, log: ast.Name) -> bool:
        match self._parents[log]:
            case ast.Call(func=function, args=[first] | [first, ast.Constant()], keywords=keywords):
                has_others = any(keyword.arg != "axis" for keyword in keywords)  # such as `dtype`
                is_of_numpy = self._bindings.origin(dotted_name(function)) in _READING
                return first is log and is_of_numpy and not has_others
        return False

    def _variation(self, view: ast.AST, loop: Loop) -> str:
        """Return why a view may not be one of a single MjData of mujoco; empty if it is."""
        root = self._root(view)
        if root is None:
            return "its MjData is not a plain name"
        names = [name.id for name in name_nodes(view)]
        values: list[ast.AST | None] = []
        if not self._script.is_data(root):  # a name for a view, or for a part of an MjData
            values = self._script.assigned(root)
            names.remove(root.id)
            if self._bindings.owner(root.id, root) is not self._bindings.scope_of(loop):
                return f"{root.id} belongs to another scope"
            if not values or None in values:
                return "its MjData is not a plain name"
        elif not self._names.is_certainly(root.id, DATA, loop):
            return f"{root.id} is not certain to be an MjData of mujoco"
        reasons = [self._names.rebinding(name, loop) for name in names]
        reasons += [self._variation(value, loop) for value in values if value]
        return next(filter(None, reasons), "")

    def _root(self, view: ast.AST) -> ast.Name | None:
        """Return the name of the MjData of a view, or else the name that the view begins with."""
        node: ast.AST = view
        while not isinstance(node, ast.Name):
            match node:
                case _ if self._script.is_data(node):
                    return None
                case ast.Attribute(value=inner) | ast.Subscript(value=inner):
                    node = inner
                case ast.Call(args=[inner, *_]) if is_call(node, "asarray"):
                    node = inner
                case ast.Call(func=ast.Attribute(value=inner)):
                    node = inner
                case _:
                    return None
        return node
