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
    last_name,
    names_in,
    nodes_inside,
    peeled,
)
from mjbench.commands.lint.stepping_script import FIELDS, SteppingScript

# What mjd_transitionFD perturbs, and what it differentiates.
_INPUTS = {"qpos", "qvel", "act", "ctrl"}
_STATE_AND_SENSORS = {*_INPUTS, "sensordata", "qacc_warmstart"}
# Functions that set a state, and those that take an array for it.
_SETS = ("mj_setState", "mj_copyData", "mj_resetData", "mj_resetDataKeyframe")
_TAKES_STATE = {"mj_setState": ("qpos", "qvel"), "mj_integratePos": ("qpos",)}


@rule(
    "MJB020",
    "finite differences, by a step for each column; mujoco.mjd_transitionFD computes all columns in"
    " one call",
)
def finite_differences(script: SteppingScript) -> Iterator[Match]:
    """Yield loops that compute the derivatives of a step column by column.

    `mjd_transitionFD` computes the matrices of the linearized step: A and B, the derivatives of the
    next state with respect to the state and the controls, and C and D, those of the sensors. It
    loops in C, and does not compute positions again where it perturbs velocities or controls.

        for i in range(model.nu):
            mujoco.mj_setState(model, data, state, spec)
            data.ctrl[i] += eps
            mujoco.mj_step(model, data)
            B[:, i] = (np.concatenate([data.qpos, data.qvel]) - following) / eps

        mujoco.mjd_transitionFD(model, data, eps, False, None, B, None, None) # instead

    There is no finding where a script perturbs positions alone, or velocities alone, because the
    call computes both; where several steps follow a perturbation; where anything but the next state
    or sensors is divided; where parameters of the model are perturbed; or where the script names
    RK4, which `mjd_transitionFD` refuses.

    Results: the same up to rounding, where every column starts from the same warm start. With
    quaternions, A has a row and a column for each degree of freedom, not for each number of `qpos`.
    """
    if "mjd_transitionFD" in script.bindings.identifiers or _names_rk4(script):
        return
    loops = (loop for loop in script.loops if isinstance(loop, ast.For))
    inputs = {loop: fields for loop in loops if (fields := _perturbed_inputs(script, loop))}
    for loop, fields in inputs.items():
        scope = script.bindings.scope_of(loop)
        beside = [inputs[each] for each in inputs if script.bindings.scope_of(each) is scope]
        if "ctrl" in fields or {"qpos", "qvel"} <= set().union(*beside):
            yield Match(loop, instead=("mjd_transitionFD",))


def _names_rk4(script: SteppingScript) -> bool:
    texts = (n.value for n in script.nodes if isinstance(n, ast.Constant))
    has_text = any(isinstance(text, str) and "RK4" in text for text in texts)
    return has_text or "mjINT_RK4" in script.bindings.identifiers


def _perturbed_inputs(script: SteppingScript, loop: ast.For) -> set[str]:
    """Return the fields by which a loop differentiates a step; none for other loops."""
    inside, index = nodes_inside(loop), names_in(loop.target)
    called = {function for node in inside for function in script.functions.called(node)}
    functions = [function for function in called if script.steps_inside(function)]
    bodies = [inside, *map(nodes_inside, functions)]
    nodes = [node for body in bodies for node in body]
    perturbed = dict(each for node in inside if (each := _perturbed(node, index)) is not None)
    inputs, sizes = set[str](), set[str]()
    for place, size in perturbed.items():
        array = place.value
        fields = {_input(script, array)} - {""}
        if isinstance(array, ast.Name):
            fields = {field for node in inside for field in _taking(script, node, {array.id})}
        inputs |= fields
        sizes |= {ast.unparse(size)} if fields else set()
    set_whole = [w[1] for n in nodes if n not in perturbed and (w := _written(script, n))]
    is_difference = (
        _takes_one_step(script, loop, bodies, len(perturbed))
        and (bool(set_whole) or any(is_call(node, *_SETS) for node in nodes))
        and all(map(_is_plain, [*set_whole, *_returned(functions)]))
        and _read_fields(script, nodes) <= _STATE_AND_SENSORS
        and not any(is_bound(n) and "model" in dotted_name(peeled(n)) for n in nodes)
        and any(_is_column(node, index) for node in inside)
        and any(_divides_by(n, sizes) for n in ast.walk(script.bindings.scope_of(loop)))
    )
    return inputs if is_difference else set()


def _perturbed(node: ast.AST, index: set[str]) -> tuple[ast.Subscript, ast.expr] | None:
    """Return the number at an index that a statement changes, and by how much."""
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
    return (place, size) if is_size and is_number else None


def _input(script: SteppingScript, array: ast.AST) -> str:
    """Return the field that an array is a view of; empty for others than the state or controls."""
    is_field = isinstance(array, ast.Attribute) and script.is_data(array.value)
    field = dotted_name(array).rpartition(".")[2] if is_field else ""
    return field if field in _INPUTS else ""


def _written(script: SteppingScript, target: ast.AST) -> tuple[str, ast.expr] | None:
    """Return the field of the state or the controls that is assigned to, and the value."""
    field = _input(script, target.value if isinstance(target, ast.Subscript) else target)
    value = script.values.get(target)
    return (field, value) if field and isinstance(value, ast.expr) else None


def _taking(script: SteppingScript, node: ast.AST, names: set[str]) -> Iterator[str]:
    """Yield the fields into which a node writes an array, itself or by what it calls."""
    if (written := _written(script, node)) is not None and names & names_in(written[1]):
        yield written[0]
    if isinstance(node, ast.Call) and names & names_in(node):
        yield from _TAKES_STATE.get(last_name(node.func), ())
        for function in script.functions.called(node):
            given = script.functions.arguments(node, function) or {}
            parameters = {name for name, value in given.items() if names & names_in(value)}
            for inner in nodes_inside(function):
                if (written := _written(script, inner)) and parameters & names_in(written[1]):
                    yield written[0]


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
