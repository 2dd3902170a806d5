"""Loops that perturb one number of the state or the controls, step, and divide by how much."""

import ast
from collections.abc import Iterator, Sequence

from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    dotted_name,
    is_bound,
    is_call,
    is_numpy_call,
    is_step,
    names_in,
    nodes_inside,
    peeled,
)
from mjbench.commands.lint.stepping_script import FIELDS, SteppingScript

# What mjd_transitionFD perturbs, and what it differentiates.
_INPUTS = {"qpos", "qvel", "act", "ctrl"}
_STATE_AND_SENSORS = {*_INPUTS, "sensordata", "qacc_warmstart"}
# Functions that set a state, and those that take an array for it.
_SETS = ("mj_setState", "mj_copyData", "mj_resetData", "mj_resetDataKeyframe", "copyto")
_TAKES_STATE = ("mj_setState", "mj_integratePos", "copyto")


@rule(
    "MJB020",
    "finite differences, by a step for each column; mujoco.mjd_transitionFD computes all columns in"
    " one call, and leaves out what a column does not change",
)
def finite_differences(script: SteppingScript) -> Iterator[Match]:
    """Yield loops that compute the derivatives of a step column by column.

    `mjd_transitionFD` computes the matrices of the linearized step: A and B, the derivatives of the
    next state with respect to the state and the controls, and C and D, those of the sensors. It
    perturbs in C, starts each solver from the same forces, and does not compute positions again
    where only velocities or controls are perturbed.

        for i in range(model.nv):
            mujoco.mj_setState(model, data, state, spec)
            data.qvel[i] += eps
            mujoco.mj_step(model, data)
            A[:, model.nv + i] = (np.concatenate([data.qpos, data.qvel]) - following) / eps

        mujoco.mjd_transitionFD(model, data, eps, False, A, B, None, None)    # instead

    There is no finding where several steps follow a perturbation, where anything but the next state
    or sensors is divided, where parameters of the model are perturbed, or where the script names
    RK4, which `mjd_transitionFD` refuses.

    Results: the same up to rounding, where every column starts from the same warm start. With
    quaternions, A has a row and a column for each degree of freedom, not for each number of `qpos`.
    """
    if "mjd_transitionFD" in script.bindings.identifiers or _names_rk4(script):
        return
    for loop in script.loops:
        if isinstance(loop, ast.For) and _is_difference(script, loop):
            yield Match(loop)


def _names_rk4(script: SteppingScript) -> bool:
    texts = (n.value for n in script.nodes if isinstance(n, ast.Constant))
    has_text = any(isinstance(text, str) and "RK4" in text for text in texts)
    return has_text or "mjINT_RK4" in script.bindings.identifiers


def _is_difference(script: SteppingScript, loop: ast.For) -> bool:
    inside, index = nodes_inside(loop), names_in(loop.target)
    called = {function for node in inside for function in script.functions.called(node)}
    functions = [function for function in called if script.steps_inside(function)]
    bodies = [inside, *map(nodes_inside, functions)]
    nodes = [node for body in bodies for node in body]
    perturbed = [each for node in inside if (each := _perturbed(node, index)) is not None]
    taken = set[str]()
    for node in inside:
        is_taken = is_call(node, *_TAKES_STATE) or set(functions) & {*script.functions.called(node)}
        taken |= names_in(node) if is_taken or _written_value(script, node) else set()
    sizes = {
        ast.unparse(size)
        for array, size in perturbed
        if _is_input(script, array) or (isinstance(array, ast.Name) and array.id in taken)
    }
    values = filter(
        None, (_written_value(script, n) for n in nodes if _perturbed(n, index) is None)
    )
    return (
        _takes_one_step(script, loop, bodies, len(perturbed))
        and any(_sets_state(script, node) for node in nodes)
        and all(map(_is_plain, [*values, *_returned(functions)]))
        and _read_fields(script, nodes) <= _STATE_AND_SENSORS
        and not any(is_bound(n) and "model" in dotted_name(peeled(n)) for n in nodes)
        and any(_is_column(node, index) for node in inside)
        and any(_divides_by(n, sizes) for n in ast.walk(script.bindings.scope_of(loop)))
    )


def _perturbed(node: ast.AST, index: set[str]) -> tuple[ast.expr, ast.expr] | None:
    """Return the array of which a statement changes the number at an index, and by how much."""
    match node:
        case ast.AugAssign(target=ast.Subscript() as place, op=ast.Add() | ast.Sub(), value=size):
            pass
        case ast.Assign(
            targets=[ast.Subscript() as place],
            value=ast.BinOp(op=ast.Add() | ast.Sub(), right=size) | size,
        ):
            pass
        case _:
            return None
    is_size = bool(dotted_name(size)) or isinstance(size, ast.Constant)
    is_number = isinstance(place.slice, ast.Name | ast.BinOp) and index & names_in(place.slice)
    return (place.value, size) if is_size and is_number else None


def _is_input(script: SteppingScript, array: ast.expr) -> bool:
    return (
        isinstance(array, ast.Attribute) and array.attr in _INPUTS and script.is_data(array.value)
    )


def _written_value(script: SteppingScript, node: ast.AST) -> ast.expr | None:
    """Return what an assignment writes into the state or the controls."""
    match node:
        case ast.Assign(targets=[target], value=value):
            array = target.value if isinstance(target, ast.Subscript) else target
            return value if _is_input(script, array) else None
    return None


def _sets_state(script: SteppingScript, node: ast.AST) -> bool:
    return _written_value(script, node) is not None or is_call(node, *_SETS)


def _is_plain(value: ast.expr) -> bool:
    """Return whether an expression holds numbers of others as they are."""
    match value:
        case ast.Name() | ast.Attribute() | ast.Constant():
            return True
        case ast.Subscript(value=inner) | ast.Call(func=ast.Attribute(value=inner, attr="copy")):
            return _is_plain(inner)
        case ast.Call(args=parts) if is_numpy_call(value):
            return all(map(_is_plain, parts))
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return all(map(_is_plain, parts))
    return False


def _returned(functions: Sequence[ast.FunctionDef]) -> Iterator[ast.expr]:
    for function in functions:
        for node in nodes_inside(function):
            if isinstance(node, ast.Return) and node.value is not None:
                yield node.value


def _takes_one_step(
    script: SteppingScript, loop: ast.For, bodies: Sequence[Sequence[ast.AST]], most: int
) -> bool:
    """Return whether each perturbation is followed by one step, in the loop or in a function."""
    steps = [[node for node in body if is_step(node)] for body in bodies]
    innermost = {next(script.loops_around(step), None) for body in steps for step in body}
    is_single = all(len(s.args) == 2 and is_call(s, "mj_step") for body in steps for s in body)
    return (
        is_single
        and innermost <= {loop, None}
        and len(steps[0]) <= most
        and all(len(body) == 1 for body in steps[1:])
    )


def _read_fields(script: SteppingScript, nodes: Sequence[ast.AST]) -> set[str]:
    """Return the fields of MjData that nodes read."""
    attributes = (n for n in nodes if isinstance(n, ast.Attribute) and not is_bound(n))
    return {n.attr for n in attributes if script.is_data(n.value) and FIELDS.match(n.attr)}


def _is_column(node: ast.AST, index: set[str]) -> bool:
    """Return whether a node writes a column, or a row, of a matrix at an index."""
    match node:
        case ast.Subscript(slice=ast.Tuple(elts=parts)):
            is_range = any(isinstance(part, ast.Slice) for part in parts)
            return is_bound(node) and is_range and not index.isdisjoint(names_in(node.slice))
    return False


def _divides_by(node: ast.AST, sizes: set[str]) -> bool:
    match node:
        case ast.BinOp(op=ast.Div(), right=divisor):
            parts: Sequence[ast.AST] = list(ast.walk(divisor))
        case ast.Call(args=arguments) if is_call(node, "mj_differentiatePos"):
            parts = arguments
        case _:
            return False
    return any(isinstance(part, ast.expr) and ast.unparse(part) in sizes for part in parts)
