"""Arrays, lists and tuples that a loop replaces by longer copies of themselves.

    log = np.vstack([log, data.qpos])

Every iteration copies all rows so far, so n iterations copy about n² / 2 rows.
"""

import ast
import re
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass

from mjbench.commands.lint.repeats import in_steps
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    block_around,
    dotted_name,
    is_bound,
    is_call,
    is_numpy_call,
    nodes_inside,
)
from mjbench.commands.lint.stepping_script import Loop, SteppingScript

_JOINS = ("vstack", "hstack", "concatenate", "column_stack", "row_stack")
# What makes an array of all rows of a list.
_CONVERSIONS = ("array", "asarray", "stack", "mean", "std", *_JOINS)
_READ_LISTS = ("len", "print", *_CONVERSIONS)
_INDEXED_JOINS = re.compile(r"(np|numpy|onp)\.[rc]_$")
# Functions that begin a simulation.
_BEGINNINGS = re.compile(r"__init__$|_*re_?set|_*set_?up")
_CONVERTED = (
    "this copies all rows of a list that grows in every step, so the time of a step grows; write"
    " each row into an array that has room for all, or update what is computed of them"
)
# Loops that are certainly shorter are not worth a finding.
_LEAST_ITERATIONS = 100


@rule(
    "MJB018",
    "this copies all rows so far in every step, so the time of a step grows; append copies to a"
    " list and stack them after the loop, or allocate all rows before it",
)
def growing_arrays(script: SteppingScript) -> Iterator[Match]:
    """Yield assignments that make an array longer in every step, by a copy.

    `np.vstack`, `np.append`, `np.concatenate` and the like copy all that they join. An array that
    grows by one row in each step is copied whole each time, so twice the steps take four times as
    long.

        log = np.empty((0, model.nq))
        for _ in range(steps):
            mujoco.mj_step(model, data)
            log = np.vstack([log, data.qpos])

        log = np.empty((steps, model.nq))                 # instead
        for step in range(steps):
            mujoco.mj_step(model, data)
            log[step] = data.qpos

    `np.array(rows)` of a list that grows by an `append` in each step copies all rows, too: where a
    mean is computed of them, a running sum does.

    Where the number of steps is not known, append `data.qpos.copy()` to a list, and stack the list
    once, after the loop. A list that grows by `rows = rows + [row]`, and a tuple by
    `rows += (row,)`, are copied as well.

    There is no finding where the loop begins the array anew or cuts it, where the array grows only
    under a condition, or in fewer than 100 iterations.

    Results: none change.
    """
    growths = [growth for node in script.nodes if (growth := _growth(script, node)) is not None]
    targets = {growth.target for growth in growths}
    loops = [*script.loops, *script.environment_loops]
    by_statement = {growth.statement: growth for growth in growths}
    for statement, each in in_steps(script, by_statement, loops, or_methods=True):
        growth = by_statement[statement]
        is_direct = isinstance(each.loop, ast.For | ast.While) and not each.functions
        is_kept = isinstance(growth.target, ast.Attribute) or is_direct
        if is_kept and not (
            script.is_conditional(statement)
            or _is_short(script, each.loop)
            or any(growth.begins_in(body, targets) for body in (each.loop, *each.functions))
            or growth.begins_elsewhere(script, targets)
        ):
            yield Match(statement, loop=each.calling_loop)
    yield from _converted_lists(script, loops)


def _converted_lists(script: SteppingScript, loops: Sequence[Loop]) -> Iterator[Match]:
    """Yield the arrays that each step makes of a whole list, to which it has appended a row."""
    conversions = [c for c in script.calls if is_numpy_call(c) and is_call(c, *_CONVERSIONS)]
    for call, each in in_steps(script, [c for c in conversions if c.args], loops):
        rows = call.args[0]
        statement = next(node for node in script.above(call) if isinstance(node, ast.stmt))
        beside = map(ast.unparse, block_around(statement, script.parents[statement]))
        if (
            any(text.startswith(f"{ast.unparse(rows)}.append(") for text in beside)
            and not script.is_conditional(call)
            and not _is_short(script, each.loop)
            and _only_grows(script, rows, (each.loop, *each.functions))
        ):
            yield Match(call, message=_CONVERTED, loop=each.calling_loop)


def _only_grows(script: SteppingScript, rows: ast.expr, bodies: Sequence[ast.AST]) -> bool:
    """Return whether a list begins empty, and bodies that run again and again only append to it."""
    values, name = script.assigned(rows), dotted_name(rows)
    if not values or not all(isinstance(v, ast.List) and not v.elts for v in values):
        return False
    inside = {node for body in bodies for node in nodes_inside(body)}
    for node in (n for n in script.nodes if dotted_name(n) == name):
        method = getattr(script.bindings.scope_of(node), "name", "")
        begins = isinstance(node, ast.Attribute) and _BEGINNINGS.match(method)
        is_outside = isinstance(node, ast.Name) and node not in inside
        if not (begins or is_outside or _is_read(script, node)):
            return False
    return True


def _is_read(script: SteppingScript, node: ast.AST) -> bool:
    """Return whether a list is appended to here, or read without what may cut it."""
    match script.parents[node]:
        case ast.Attribute() as method:
            return is_call(script.parents[method], "append")
        case ast.Subscript(ctx=ast.Load()):
            return True
        case ast.Call() as call:
            return is_call(call, *_READ_LISTS)
    return False


@dataclass(frozen=True)
class _Growth:
    """A statement that replaces what a name or an attribute holds by a longer copy."""

    statement: ast.Assign | ast.AugAssign
    target: ast.expr

    def begins_in(self, body: ast.AST, growing: Set[ast.expr]) -> bool:
        """Return whether a body binds the name in other ways than those that grow."""
        name = dotted_name(self.target)
        bound = {n for n in nodes_inside(body) if is_bound(n) and dotted_name(n) == name}
        return not bound <= growing

    def begins_elsewhere(self, script: SteppingScript, growing: Set[ast.expr]) -> bool:
        """Return whether a function that the loop may call begins an attribute anew."""
        scope = script.bindings.scope_of(self.statement)
        return any(
            isinstance(node, ast.Attribute)
            and is_bound(node)
            and node.attr == getattr(self.target, "attr", None)
            and node not in growing
            and (other := script.bindings.scope_of(node)) is not scope
            and not _BEGINNINGS.match(getattr(other, "name", ""))
            for node in script.nodes
        )


def _growth(script: SteppingScript, node: ast.AST) -> _Growth | None:
    parts: list[ast.expr] = []
    match node:
        case ast.AugAssign(target=target, op=ast.Add(), value=ast.Tuple(elts=[_, *_])):
            parts = [target] if _begins_as(script, node, target, ast.Tuple) else []
        case ast.Assign(targets=[target], value=ast.BinOp(op=ast.Add(), right=ast.List()) as both):
            parts = [both.left] if _begins_as(script, node, target, ast.List) else []
        case ast.Assign(targets=[target], value=ast.Call(args=[joined, *more]) as call) if (
            is_numpy_call(call)
        ):
            if is_call(call, "append") and more:
                parts = [joined]
            elif is_call(call, *_JOINS) and isinstance(joined, ast.Tuple | ast.List):
                parts = joined.elts if len(joined.elts) > 1 else []
        case ast.Assign(
            targets=[target], value=ast.Subscript(value=join, slice=ast.Tuple(elts=rows))
        ):
            parts = rows if _INDEXED_JOINS.match(dotted_name(join)) else []
        case _:
            return None
    name = dotted_name(target)
    return _Growth(node, target) if name and name in map(dotted_name, parts) else None


def _begins_as(
    script: SteppingScript, node: ast.Assign | ast.AugAssign, target: ast.expr, kind: type[ast.expr]
) -> bool:
    """Return whether all else that is assigned to what grows is a list, or a tuple."""
    values = [value for value in script.assigned(target) if value is not node.value]
    if isinstance(node, ast.AugAssign) and None in values:
        values.remove(None)  # its own
    return bool(values) and all(isinstance(value, kind) for value in values)


def _is_short(script: SteppingScript, loop: ast.AST) -> bool:
    match loop:
        case ast.For(iter=ast.Call(args=[count]) as iterable) if is_call(iterable, "range"):
            number = getattr(script.resolved(count), "value", None)
            return isinstance(number, int) and number < _LEAST_ITERATIONS
    return False
