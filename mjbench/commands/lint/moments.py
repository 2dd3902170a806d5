"""Rows of a log that mix two moments: the new state, and what is still computed from another.

`mj_step` computes positions, contacts, forces and sensors, and then integrates. After it, `qpos`,
`qvel`, `act` and `time` are those of the new state; all that was computed is not, until something
computes it again. A row counts where this is certain: the last call before it, of those that may
compute something, is a step of the same MjData, in every iteration.
"""

import ast
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.commands.lint.forward import COMPUTED, STATE, enough_for
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    FUNCTIONS,
    dotted_name,
    is_bound,
    is_numpy_call,
    is_step,
    last_name,
    nodes_inside,
    peeled,
)
from mjbench.commands.lint.stepping_script import (
    FIELDS,
    PART_PREFIXES,
    STORING_METHODS,
    VIEW_METHODS,
    SteppingBody,
    SteppingScript,
)
from mjbench.commands.lint.stored_views import Store, StoredViews, store_of, stored_views
from mjbench.formats import listed

# What a step integrates, and what is neither that nor computed from a state.
_INTEGRATED = ("qpos", "qvel", "act", "time")
_OF_NO_MOMENT = STATE | {"qacc_warmstart", "plugin_state"}
_COMPUTED_NUMBERS = {"contact", "ncon", "nefc"}
# Methods that write a row; those of other objects, and built-in functions, that compute nothing.
_WRITING_METHODS = {"log", "write", "writerow"}
_HARMLESS = {
    *("abs", "bool", "dict", "enumerate", "float", "int", "len", "list", "max", "min", "print"),
    *("range", "round", "sorted", "str", "sum", "tuple", "zip"),
    *("astype", "copy", "flatten", "format", "is_running", "item", "items", "join", "keys"),
    *("render", "tolist", "update_scene", "values"),
    *(STORING_METHODS | VIEW_METHODS | _WRITING_METHODS),
}
_HARMLESS_MODULES = ("numpy", "math", "random", "time")
# How the functions of the engine begin that compute nothing in an MjData.
_READING = ("mju_", "mj_jac", "mj_getState", "mj_id2name", "mj_name2id", "mj_contactForce")
_BRANCHES = ast.If | ast.IfExp | ast.BoolOp | ast.ExceptHandler | ast.match_case


@dataclass(frozen=True)
class _LastStep:
    """The last step before a row; `model` and `data` are as they are written.

    Attributes:
      is_single: whether it is one call for one step, so that the state may be copied before it.
      computed_since: fields of the new state that were computed after it.
    """

    model: str
    data: str
    is_single: bool
    computed_since: frozenset[str]


@rule(
    "MJB015",
    "a row mixes the new state with what is still computed from the one before",
    is_wrong_result=True,
)
def rows_of_two_moments(script: SteppingScript) -> Iterator[Match]:
    """Yield rows that hold the new state beside what is computed from another one.

    `mj_step` computes positions, contacts, forces and sensors of the state that it begins with, and
    then integrates. After it, `qpos`, `qvel`, `act` and `time` belong to the new state, and all
    else to the one before, until something computes it again. In a row with both, one is a step
    late.

        mujoco.mj_step(model, data)
        log.append((data.qpos.copy(), data.site("tip").xpos.copy()))

        mujoco.mj_step(model, data)     # instead: both of the new state
        mujoco.mj_kinematics(model, data)
        log.append((data.qpos.copy(), data.site("tip").xpos.copy()))

        qpos = data.qpos.copy()         # or: both of the state before, at no cost
        mujoco.mj_step(model, data)
        log.append((qpos, data.site("tip").xpos.copy()))

    `mj_kinematics` computes positions of bodies, geoms and sites; contacts, forces and sensors need
    `mj_forward`. The second way is for single steps of other integrators than `RK4`, after which
    positions are those of the last of its four stages. A row at the top of a loop mixes the same
    two moments. What no step moves, such as the position of a fixed body, is right in either state.

    There is no finding for an observation: for what a function returns, or what a policy gets. It
    may be late on purpose, as in Gymnasium's environments, and a policy that was trained on it
    expects it.

    Results: the rows hold one moment. In MuJoCo 4.0.0 the simulation stays as it is, bit for bit;
    up to 3.3.5, `mj_forward` changes later states by the solver's tolerance. A program that
    steps from what it reads in the rows, be it as text, gets other states in every release.
    """
    stored = stored_views(script)
    for body in (*script.loops, *script.methods):
        if _sets_state(script, body):
            continue
        for node in nodes_inside(body):
            if stored.loop_around(node) is (None if isinstance(body, FUNCTIONS) else body):
                for row in _logged(script, stored, node, body):
                    yield from _mixed(script, row, body)


def _sets_state(script: SteppingScript, body: SteppingBody) -> bool:
    """Return whether a body writes the state itself, which then is not that of a step."""
    return any(
        field in _INTEGRATED
        for node in nodes_inside(body)
        if is_bound(node)
        for _, field in _readings(script, peeled(node))
    )


def _logged(
    script: SteppingScript, stored: StoredViews, node: ast.AST, body: SteppingBody
) -> Iterator[ast.expr]:
    store = store_of(node)
    if isinstance(node, ast.Call) and not isinstance(script.parents[node], ast.Expr):
        return  # `np.log(x)`
    if isinstance(node, ast.Call) and last_name(node.func) in _WRITING_METHODS:
        store = Store(node.func, None, node.args)
    if store is None or (isinstance(node, ast.Assign) and store.key is None):
        return
    if script.is_view(store.place) or not stored.adds(store.key, body):
        return
    for value in store.values:
        if not isinstance(value, ast.Lambda):
            row = script.resolved(value)  # what the body assigns to a name
            yield row if row in nodes_inside(body) and not script.is_view(row) else value


def _mixed(script: SteppingScript, row: ast.expr, body: SteppingBody) -> Iterator[Match]:
    fields_of: defaultdict[str, dict[str, None]] = defaultdict(dict)  # as sets that have an order
    for node in (row, *nodes_inside(row)):
        for data, field in _readings(script, node):
            fields_of[data][field] = None
    for data, fields in fields_of.items():
        state = [field for field in fields if field in _INTEGRATED]
        computed = {field for field in fields if is_computed(field)}
        last = _last_step(script, row, body, data) if state and computed else None
        late = sorted(computed - last.computed_since) if last else ()
        if last and late:
            yield Match(row, message=_message(last, state, late))


def is_computed(field: str) -> bool:
    """Return whether a step computes a field of MjData from the state that it begins with."""
    is_array = bool(FIELDS.match(field)) and field not in _OF_NO_MOMENT
    return is_array or field in _COMPUTED_NUMBERS


def _readings(script: SteppingScript, node: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield the MjData and the field that a node reads; those of the views that a name is."""
    if isinstance(node, ast.Name):
        for value in filter(None, script.assigned(node) if script.is_alias(node) else ()):
            yield from (r for n in ast.walk(value) for r in _readings(script, n) if n is not node)
    elif isinstance(node, ast.Attribute) and script.is_data(node.value):
        yield dotted_name(node.value), node.attr
    elif isinstance(node, ast.Attribute) and script.is_named_part(node.value):
        owner = node.value
        access = owner if isinstance(owner, ast.Call) else script.assigned(owner)[0]
        assert isinstance(access, ast.Call) and isinstance(access.func, ast.Attribute)
        prefix = PART_PREFIXES.get(access.func.attr, "")
        yield dotted_name(access.func.value), prefix + node.attr


def _last_step(
    script: SteppingScript, row: ast.expr, body: SteppingBody, data: str
) -> _LastStep | None:
    """Return the last step of an MjData before a row; None where it is not certain."""
    around = set(script.above(row, body))
    place = row.lineno, row.col_offset
    apart = around.union(ast.walk(row))
    calls = [n for n in nodes_inside(body) if isinstance(n, ast.Call) and n not in apart]
    calls.sort(key=lambda call: (call.lineno, call.col_offset), reverse=True)
    before = [call for call in calls if (call.lineno, call.col_offset) < place]
    after = [] if isinstance(body, FUNCTIONS) else calls[: len(calls) - len(before)]
    computed: set[str] = set()
    for call in (*before, *after):  # the latest first; what stands after the row ran before it
        if _is_harmless(script, call):
            continue
        name, given = last_name(call.func), call.args[1:2]
        branches = {n for n in script.above(call, body) if isinstance(n, _BRANCHES)}
        if not given or dotted_name(given[0]) != data or not branches <= around:
            return None
        if name in COMPUTED:
            computed |= COMPUTED[name]
            continue
        if not is_step(call) or name == "mj_step1":
            return None
        loops = {n for n in script.above(call, body) if isinstance(n, ast.For | ast.While)}
        is_single = not call.args[2:] and not call.keywords and loops <= around
        return _LastStep(ast.unparse(call.args[0]), data, is_single, frozenset(computed))
    return None


def _is_harmless(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether a call certainly computes nothing in an MjData."""
    name = last_name(call.func) or (call.func.attr if isinstance(call.func, ast.Attribute) else "")
    if is_numpy_call(call) or script.is_named_access(call) or name.startswith(_READING):
        return True
    origin = script.bindings.origin(dotted_name(call.func)).partition(".")[0]
    return origin in _HARMLESS_MODULES or (name in _HARMLESS and not script.functions.called(call))


def _message(last: _LastStep, state: Sequence[str], late: Sequence[str]) -> str:
    functions = enough_for({*late}) or ["mj_forward"]
    calls = ", ".join(f"{name}({last.model}, {last.data})" for name in functions)
    old, new = listed(late), listed(state)
    verb = "belongs" if len(late) == 1 else "belong"
    copies = f", or copy {new} before the step and the rest after it" if last.is_single else ""
    return (
        f"{old} still {verb} to the state before the last step, {new} to the one after it: call"
        f" {calls} before this row{copies}"
    )
