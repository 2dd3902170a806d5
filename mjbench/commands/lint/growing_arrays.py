"""Arrays, lists and tuples that a loop replaces by longer copies of themselves.

    log = np.vstack([log, data.qpos])

Every iteration copies all rows so far, so n iterations copy about n² / 2 rows.
"""

import ast
import re
from collections.abc import Iterator, Set
from dataclasses import dataclass

from mjbench.commands.lint.repeats import in_steps
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    dotted_name,
    is_bound,
    is_call,
    is_numpy_call,
    nodes_inside,
)
from mjbench.commands.lint.stepping_script import SteppingScript

_JOINS = ("vstack", "hstack", "concatenate", "column_stack", "row_stack")
_INDEXED_JOINS = re.compile(r"(np|numpy|onp)\.[rc]_$")
# Functions that begin a simulation.
_BEGINNINGS = re.compile(r"__init__$|_*re_?set|_*set_?up")
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
            or _is_short(each.loop)
            or any(growth.begins_in(body, targets) for body in (each.loop, *each.functions))
            or growth.begins_elsewhere(script, targets)
        ):
            yield Match(statement, loop=each.calling_loop)


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


def _is_short(loop: ast.AST) -> bool:
    match loop:
        case ast.For(iter=ast.Call(args=[ast.Constant(value=int(count))]) as iterable):
            return is_call(iterable, "range") and count < _LEAST_ITERATIONS
    return False
