"""Views that a function or a property of the script returns, and that its caller writes into.

    obs = env.state()               # returns self.data.qpos
    obs -= mean                     # moves the robot

A caller that means to set the state says so: it computes what follows from it, by `mj_forward` or
the like, in a method called `reset` or `set_…`, through a function named after the field, as `qpos`
is, or as a view. Such a caller is left out.
"""

import ast
import re
from collections.abc import Iterator

from mjbench.loop.lint_rule import Match, rule
from mjbench.loop.script_syntax import last_name, names_in
from mjbench.loop.stepping_script import FIELDS, SteppingScript
from mjbench.loop.stored_views import Source, StoredViews, stored_views
from mjbench.loop.view_writes import WRITING_FUNCTIONS, WRITING_METHODS

# What does not write through a view: `resize` raises an error, and `setflags(write=False)` prevents
# writes. The first argument of `partial` is a function.
_METHODS = WRITING_METHODS - {"resize", "setflags"}
_FUNCTIONS = WRITING_FUNCTIONS - {"partial"}
# Functions that set a state, or compute what follows from one that was set.
_SETS = re.compile(r"(mj_(forward|kinematics|fwdPosition|setState)|(re)?set(_\w+)?|forward)$")
_PROMISES_VIEW = re.compile(r"(^|_)(view|ref|pointer|ptr|proxy|buffer)s?(_|$)")


@rule(
    "MJB016",
    "this writes into the simulation, through a view that a function returns; copy it",
    is_wrong_result=True,
)
def written_views(script: SteppingScript) -> Iterator[Match]:
    """Yield what writes into a view that a name got from a function of the script.

    A function that returns `data.qpos`, or a slice of it, returns a view: an array that shows the
    memory of the MjData. A caller that writes into it, to scale or clip an observation, writes into
    the simulation, and the next step goes on from there.

        def state(self):
            return self.data.qpos       # write: return self.data.qpos.copy()

        obs = env.state()
        obs -= mean                     # or here: obs = env.state() - mean

    There is no finding where the caller seems to set the state: where `mj_forward` or the like
    follows, in a method called `reset` or `set_...`, or where the function is named after the field
    or as a view.

    Results: the simulation keeps its own state, so all later states differ.
    """
    if not any(isinstance(n, ast.Attribute) and FIELDS.match(n.attr) for n in script.nodes):
        return
    stored = stored_views(script)
    for node in script.nodes:
        if not isinstance(node, ast.expr | ast.stmt):
            continue
        for name in _written(node):
            source = _source(script, stored, name)
            if source is None or _sets_state(script, node):
                continue
            for function, view in stored.returned(source):
                if not _promises_view(function, view):
                    yield Match(node, message=_message(name, function, view))


def _written(node: ast.expr | ast.stmt) -> Iterator[ast.Name]:
    """Yield the names of arrays that a node certainly writes into."""
    written: list[ast.expr] = []
    if isinstance(node, ast.AugAssign):
        written = [node.target]
    elif isinstance(node, ast.Assign):
        parts = [target for target in node.targets if isinstance(target, ast.Subscript)]
        written = [part for part in parts if not _replaces_all(part, node.value)]
    elif isinstance(node, ast.Call):
        written = [keyword.value for keyword in node.keywords if keyword.arg == "out"]
        function = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        if function in _FUNCTIONS:
            written += node.args[:1]
        if function in _METHODS:
            assert isinstance(node.func, ast.Attribute)
            written.append(node.func.value)
    for each in written:
        array = each.value if isinstance(each, ast.Subscript) else each
        if isinstance(array, ast.Name):
            yield array


def _replaces_all(part: ast.Subscript, value: ast.expr) -> bool:
    """Return whether `x[:] = value` replaces all of an array by what does not follow from it."""
    is_whole = isinstance(part.slice, ast.Slice) and not (part.slice.lower or part.slice.upper)
    return is_whole and names_in(part.value).isdisjoint(names_in(value))


def _source(script: SteppingScript, stored: StoredViews, name: ast.Name) -> Source | None:
    """Return where the one value of a name comes from; None where it has others."""
    bindings = script.bindings.of_name(name)
    values = [b for b in bindings if not isinstance(script.parents.get(b), ast.AugAssign)]
    return stored.source_of_binding(values[0]) if len(values) == 1 else None


def _sets_state(script: SteppingScript, node: ast.expr | ast.stmt) -> bool:
    """Return whether the function around a write, or the rest of it, sets a state on purpose."""
    scope = script.bindings.scope_of(node)
    calls = (n for n in ast.walk(scope) if isinstance(n, ast.Call) and n.lineno > node.lineno)
    names = {last_name(call.func) for call in calls} | {getattr(scope, "name", "")}
    return any(map(_SETS.match, names))


def _promises_view(function: ast.FunctionDef, view: ast.expr) -> bool:
    fields = {n.attr for n in ast.walk(view) if isinstance(n, ast.Attribute)}
    return function.name in fields or bool(_PROMISES_VIEW.search(function.name))


def _message(name: ast.Name, function: ast.FunctionDef, view: ast.expr) -> str:
    getter = function.name if function.decorator_list else f"{function.name}()"
    return (
        f"this writes into {ast.unparse(view)} of the simulation, which {getter} returns:"
        f" write into a copy, {name.id} = {name.id}.copy()"
    )
