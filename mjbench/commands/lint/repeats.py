"""In the iterations of which loops a part of a script runs, and what varies from one to the next.

A part runs in an iteration where it stands in the loop, or in a function that the loop calls,
without anything that may let it run once only: a condition on what the loop changes, a `return`
before it, a `break` after it, an `except`.
"""

import ast
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import TypeVar

from mjbench.commands.lint.script_syntax import (
    COMPREHENSIONS,
    FUNCTIONS,
    attributes_in,
    block_around,
    bound_in,
    dotted_name,
    is_call,
    is_periodic,
    is_step,
    last_name,
    names_in,
    nodes_inside,
    peeled,
)
from mjbench.commands.lint.stepping_script import Loop, SteppingScript

Repetition = ast.For | ast.While | COMPREHENSIONS
_Node = TypeVar("_Node", bound=ast.expr | ast.stmt)
_CREATE_MODEL = (
    *("from_xml_path", "from_xml_string", "from_binary_path", "from_mjcf_model"),
    *("compile", "recompile", "load_model"),
)


@dataclass(frozen=True, eq=False)
class Iteration:
    """A loop, a comprehension, or a method that steps, in whose every iteration something runs.

    Attributes:
      inside: what stands in the loop itself: the part, or the call that leads to it.
    """

    loop: Repetition | ast.FunctionDef
    inside: ast.expr | ast.stmt
    functions: tuple[ast.FunctionDef, ...] = ()

    @property
    def calling_loop(self) -> Repetition | ast.FunctionDef | None:
        """The loop, where the part stands in a function that it calls."""
        return self.loop if self.functions else None

    def varying_names(self, script: SteppingScript) -> set[str]:
        """Return the names that the loop runs over, and those whose values follow from them."""
        if isinstance(self.loop, ast.For):
            names = names_in(self.loop.target)
        elif isinstance(self.loop, COMPREHENSIONS):
            names = {name for each in self.loop.generators for name in names_in(each.target)}
        else:
            names = set()
        return following(script, self.loop, names)

    def makes_model(self) -> bool:
        has_new = not _new_models(self.loop).isdisjoint(names_in(self.inside))
        return has_new or any(map(_new_models, self.functions))


def following(
    script: SteppingScript, scope: ast.AST, names: Set[str], attributes: Set[str] = frozenset()
) -> set[str]:
    """Return names, and those whose values in a scope follow from them or from attributes."""
    flows = [flow for node in ast.walk(scope) for flow in _flows(node)]
    result = set(names)
    while more := {
        name
        for targets, value in flows
        if names_in(value) & result or attributes_in(value) & attributes
        for name in targets - result
        if not script.bindings.origin(name)  # a module stays what it is
    }:
        result |= more
    return result


def in_steps(
    script: SteppingScript, nodes: Iterable[_Node], loops: Sequence[Loop], or_methods: bool = False
) -> Iterator[tuple[_Node, Iteration]]:
    """Yield the nodes that run in every step of a loop, directly or in a function that it calls.

    Where asked, also those of methods that step, as `step` of an environment does in others' loops.
    """
    methods = {each for each in script.methods if or_methods and "step" in each.name}
    inside = {loop: {*nodes_inside(loop)} for loop in loops}
    for node in nodes:
        loop = script.step_loop_around(node)
        if loop in inside and node in inside[loop]:
            yield node, Iteration(loop, node)
        elif (each := step_loop_of_helper(script, node)) is not None and each.loop in inside:
            yield node, each
        elif methods:
            around = iterations(script, node, or_functions=True)
            yield from ((node, each) for each in around if each.loop in methods)


def step_loop_of_helper(script: SteppingScript, node: ast.expr | ast.stmt) -> Iteration | None:
    """Return the loop in whose every step a function that it calls runs a node.

    None stands for a node in a loop that steps, and for one that no such loop is certain to run.
    """
    for each in iterations(script, node):
        is_step_loop = script.step_loop_around(each.inside) is each.loop
        if is_step_loop or any(_steps_once(script, function) for function in each.functions):
            return each if each.functions else None
    return None


def _steps_once(script: SteppingScript, function: ast.FunctionDef) -> bool:
    inner = {n for n in nodes_inside(function) if isinstance(n, ast.For | ast.While)}
    steps = (n for n in nodes_inside(function) if is_step(n))
    return any(inner.isdisjoint(script.loops_around(step)) for step in steps)


def iterations(
    script: SteppingScript,
    node: ast.expr | ast.stmt,
    functions: tuple[ast.FunctionDef, ...] = (),
    or_functions: bool = False,
) -> Iterator[Iteration]:
    """Yield the loops in whose every iteration a node runs, the innermost of each way first.

    Where asked, also the functions of which every call runs it.
    """
    child: ast.AST = node
    for parent in script.above(node):
        if isinstance(parent, ast.Lambda | ast.ClassDef):
            return
        if isinstance(parent, Repetition) and _is_repeated(child, parent):
            if _may_run_once(script, node, parent):
                return
            yield Iteration(parent, node, functions)
        elif isinstance(parent, FUNCTIONS):
            if not isinstance(parent, ast.FunctionDef) or parent in functions:
                return
            if not _may_run_once(script, node, parent):
                if or_functions:
                    yield Iteration(parent, node, functions)
                for call in script.functions.calls_of(parent):
                    yield from iterations(script, call, (parent, *functions), or_functions)
            return
        child = parent


def _is_repeated(child: ast.AST, loop: Repetition) -> bool:
    if isinstance(loop, COMPREHENSIONS):
        return child is not loop.generators[0] or not isinstance(child, ast.comprehension)
    if isinstance(loop, ast.For) and child in (loop.iter, loop.target):
        return False
    return child not in loop.orelse


def _may_run_once(
    script: SteppingScript, node: ast.expr | ast.stmt, limit: Repetition | ast.FunctionDef
) -> bool:
    """Return whether a node may run in one iteration of a loop, or one call, only."""
    child: ast.AST = node
    while child is not limit:
        parent = script.parents[child]
        match parent:
            case ast.ExceptHandler() | ast.match_case():
                return True
            case ast.Try(orelse=block) if child in block:
                return True
            case ast.With() if _expects_error(parent):
                return True
            case ast.If(test=test) | ast.IfExp(test=test) if child is not test:
                if not _is_regular(test, limit):
                    return True
            case ast.BoolOp(values=[first, *_]) if child is not first:
                return True
        block = block_around(child, parent)
        rest = block[block.index(child) + 1 :] if isinstance(child, ast.stmt) and block else []
        leaves = any(isinstance(n, ast.Return | ast.Break | ast.Raise) for n in rest)
        if leaves and not isinstance(limit, ast.FunctionDef):
            return True
        child = parent
    passes_by = ast.Return if isinstance(limit, ast.FunctionDef) else ast.Continue
    return any(isinstance(n, passes_by) and n.lineno < node.lineno for n in nodes_inside(limit))


def _expects_error(node: ast.With) -> bool:
    contexts = (item.context_expr for item in node.items)
    calls = (c.func for c in contexts if isinstance(c, ast.Call))
    return any("raises" in last_name(function).lower() for function in calls)


def _is_regular(condition: ast.expr, limit: Repetition | ast.FunctionDef) -> bool:
    """Return whether a condition holds in each nth iteration, or in all of them or in none."""
    plain = ast.Name | ast.Not | ast.UnaryOp | ast.expr_context
    is_plain = all(isinstance(part, plain) for part in ast.walk(condition))
    is_same = is_plain and names_in(condition).isdisjoint(bound_in(limit))
    return is_periodic(condition) or (is_same and not isinstance(limit, ast.FunctionDef))


def _flows(node: ast.AST) -> Iterator[tuple[set[str], ast.AST]]:
    """Yield the names that a node gives a value, and the value."""
    if isinstance(node, ast.Assign):
        yield {name for target in node.targets for name in _roots(target)}, node.value
    elif isinstance(node, ast.AugAssign | ast.AnnAssign | ast.NamedExpr) and node.value is not None:
        yield _roots(node.target), node.value
    elif isinstance(node, ast.For | ast.comprehension):
        yield names_in(node.target), node.iter
    elif isinstance(node, ast.withitem) and node.optional_vars is not None:
        yield names_in(node.optional_vars), node.context_expr
    elif isinstance(node, ast.Call):  # a method that changes its object, a function its arguments
        receivers = [node.func.value] if isinstance(node.func, ast.Attribute) else []
        yield {name for each in receivers for name in _roots(each)}, node
    elif isinstance(node, ast.If | ast.While):  # what is assigned under a condition
        yield bound_in(node), node.test


def _roots(target: ast.AST) -> set[str]:
    """Return the names of the objects that an assignment changes: `spec` of `spec.option.x`."""
    elements = target.elts if isinstance(target, ast.Tuple | ast.List) else [target]
    dotted = (dotted_name(peeled(element)) for element in elements)
    return {name.partition(".")[0] for name in dotted} - {""}


def creates_model(node: ast.AST, by_any_call: bool = False) -> bool:
    calls = (n for n in ast.walk(node) if isinstance(n, ast.Call))
    return any(by_any_call or is_call(call, *_CREATE_MODEL) for call in calls)


def _new_models(scope: Repetition | ast.FunctionDef) -> set[str]:
    assigns = (node for node in ast.walk(scope) if isinstance(node, ast.Assign))
    return {
        name
        for node in assigns
        if creates_model(node.value, by_any_call=isinstance(node.targets[0], ast.Tuple))
        for target in node.targets
        for name in names_in(target)
    }
