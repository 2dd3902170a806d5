"""Simulations that begin anew: what they repeat each time, and what threads could do for all."""

import ast
import re
from collections.abc import Iterator, Sequence

from mjbench.commands.lint.repeats import Iteration, following, iterations
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    COMPREHENSIONS,
    block_around,
    bound_in,
    dotted_name,
    is_bound,
    is_call,
    is_step,
    names_in,
    nodes_inside,
    parameters_of,
    peeled,
)
from mjbench.commands.lint.stepping_script import STORING_METHODS, SteppingScript

# The code of the rule on steps that follow each reset.
SETTLED_RESET = "MJB023"
_RESETS = ("mj_resetData", "mj_resetDataKeyframe")
# Calls that begin an episode.
_EPISODE_STARTS = (*_RESETS, "mj_setState", "MjData")
# What `rollout` returns of each step, and takes for it.
_OF_ROLLOUT = {"qpos", "qvel", "act", "time", "sensordata", "ctrl"}
# Methods of environments that others call for each episode.
_RESET_METHOD = re.compile(r"_*reset")
# Fewer steps are not worth a finding.
_LEAST_SETTLING = 10


@rule(
    "MJB006",
    "a loop over simulations around a loop over steps; mujoco.rollout or mujoco.batch does both"
    " on threads (mjbench compare says which)",
)
def serial_simulations(script: SteppingScript) -> Iterator[Match]:
    """Yield loops that begin a simulation in each iteration, and step it in a loop inside.

    Simulations that do not depend on each other run one after another, on one core, and Python runs
    between the steps. `mujoco.rollout`, from MuJoCo 3.2.7 on, and `mujoco.batch` step them on
    threads, and `mjbench compare` says which is fastest for a model.

        for plan in plans:
            mujoco.mj_resetData(model, data)
            for ctrl in plan:
                data.ctrl[:] = ctrl
                mujoco.mj_step(model, data)

        states, sensors = rollout.rollout(model, datas, starts, plans)    # instead

    The same holds where a comprehension, or a loop that stores results, calls a function that steps
    through a plan.

    Results: none change where the controls are known before the steps.
    """
    for loop in script.episode_loops:
        starts = (node for node in nodes_inside(loop) if is_call(node, *_EPISODE_STARTS))
        begins = any(loop is each.loop for node in starts for each in iterations(script, node))
        inner = (node for node in nodes_inside(loop) if isinstance(node, ast.For))
        if begins and any(any(map(is_step, nodes_inside(each))) for each in inner):
            yield Match(loop)
    message = (
        "these controls are known before the steps: mujoco.rollout steps all simulations in one"
        " call, on threads"
    )
    for loop in (node for node in script.nodes if isinstance(node, ast.For)):
        if _follows_plan(script, loop):
            for each in iterations(script, loop):
                if len(each.functions) == 1 and _is_independent(each):
                    yield Match(each.loop, message=message, instead=("rollout",))


def _follows_plan(script: SteppingScript, loop: ast.For) -> bool:
    """Return whether a loop of a function steps from a start, by controls from a sequence.

    It does nothing that `rollout` does not do for a whole plan.
    """
    function, inside = script.bindings.scope_of(loop), nodes_inside(loop)
    calls = [node for node in inside if isinstance(node, ast.Call)]
    steps = [call for call in calls if is_step(call)]
    if not isinstance(function, ast.FunctionDef) or [len(step.args) for step in steps] != [2]:
        return False
    model, data = map(dotted_name, steps[0].args)
    others = [call for call in calls if call not in steps]
    handed = {dotted_name(argument) for call in others for argument in call.args}
    fields = {
        n.attr for n in inside if isinstance(n, ast.Attribute) and dotted_name(n.value) == data
    }
    written = {dotted_name(peeled(n)): script.values.get(n) for n in inside if is_bound(n)}
    controls = written.pop(f"{data}.ctrl", None)
    given = set() if controls is None else names_in(controls)
    return (
        any(is_call(n, *_EPISODE_STARTS) and n.lineno < loop.lineno for n in nodes_inside(function))
        and not given.isdisjoint(names_in(loop.target))
        and given.isdisjoint(following(script, loop, {data}))
        and not any(isinstance(n, ast.Break | ast.Return | ast.For | ast.While) for n in inside)
        and fields <= _OF_ROLLOUT
        and handed.isdisjoint({data, model})
        and not any(map(script.functions.called, others))
        and not any(name.startswith(f"{data}.") for name in written)
        and not _is_written(nodes_inside(function), model)
    )


def _is_written(nodes: Sequence[ast.AST], owner: str) -> bool:
    return any(is_bound(n) and dotted_name(peeled(n)).startswith(f"{owner}.") for n in nodes)


def _is_independent(each: Iteration) -> bool:
    """Return whether a loop only stores what a function returns, of what was there before it."""
    if isinstance(each.loop, COMPREHENSIONS):
        return True
    if not isinstance(each.loop, ast.For) or len(each.loop.body) != 1:
        return False
    match each.loop.body[0]:
        case ast.Assign(targets=[ast.Subscript()], value=call):
            is_stored = call is each.inside
        case ast.Expr(value=ast.Call(func=ast.Attribute(attr=method), args=[call])):
            is_stored = call is each.inside and method in STORING_METHODS
        case _:
            return False
    others = bound_in(each.loop) - names_in(each.loop.target)
    return is_stored and names_in(each.inside).isdisjoint(others)


@rule(
    SETTLED_RESET,
    "the same steps follow each reset: settle once, keep that state (mjSTATE_INTEGRATION), and set"
    " it by mj_setState",
)
def settled_resets(script: SteppingScript) -> Iterator[Match]:
    """Yield steps that settle a model after each reset, from the same state every time.

    A simulation is deterministic: the same steps from the same state end in the same state, which
    can be kept.

        for episode in range(1000):
            mujoco.mj_resetData(model, data)
            for _ in range(500):
                mujoco.mj_step(model, data)

        for _ in range(500):            # instead, before the loop
            mujoco.mj_step(model, data)
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        settled = np.empty(mujoco.mj_stateSize(model, spec))
        mujoco.mj_getState(model, data, settled, spec)

        for episode in range(1000):
            mujoco.mj_setState(model, data, settled, spec)

    There is no finding where anything stands between the reset and the steps, where no steps follow
    in the episode, where a script writes to the model or sets a callback, or for fewer than 10
    steps.

    Results: none change, but what follows from the state, such as `xpos`, is that of before until a
    step or `mj_forward` computes it. `mj_copyData` from a settled MjData copies that, too.
    """
    identifiers = script.bindings.identifiers
    has_callback = any(name.startswith("set_mjcb_") for name in identifiers)
    if has_callback or any(_is_written(script.nodes, name) for name in script.model_names - {""}):
        return
    for call in script.calls:
        reset = script.parents[call]
        if not is_call(call, *_RESETS) or not isinstance(reset, ast.Expr):
            continue
        block = block_around(reset, script.parents[reset])
        after = block[block.index(reset) + 1 :] if reset in block else []
        if after and _settles(script, after[0], call) and _is_repeated(script, after[0], call):
            yield Match(after[0])


def _settles(script: SteppingScript, statement: ast.stmt, reset: ast.Call) -> bool:
    """Return whether a statement steps a fixed number of times after a reset to a fixed state."""
    given = re.escape(", ".join(map(ast.unparse, reset.args[:2])))
    patterns = (
        rf"for \w+ in range\(([\w.]+)\):\n    (?:\w+\.)?mj_step\({given}\)",
        rf"(?:\w+\.)?mj_step\({given}, (?:nstep=)?([\w.]+)\)",
    )
    text = ast.unparse(statement)
    matching = next(filter(None, (re.fullmatch(pattern, text) for pattern in patterns)), None)
    if matching is None or not all(isinstance(key, ast.Constant) for key in reset.args[2:]):
        return False
    if matching[1].isdigit():
        return int(matching[1]) >= _LEAST_SETTLING
    function = script.bindings.scope_of(statement)
    given_names = parameters_of(function) if isinstance(function, ast.FunctionDef) else []
    bound = {dotted_name(n) for n in nodes_inside(function) if is_bound(n)}
    return matching[1] not in {*given_names, *bound}


def _is_repeated(script: SteppingScript, settling: ast.stmt, reset: ast.Call) -> bool:
    """Return whether a reset of one model begins each episode, which steps after it has settled."""
    function, model = script.bindings.scope_of(reset), reset.args[0]
    if len(script.assigned(model)) > 1:
        return False
    owner = script.parents.get(function)
    if isinstance(owner, ast.ClassDef) and _RESET_METHOD.match(getattr(function, "name", "")):
        steps_elsewhere = any(each in owner.body for each in script.methods if each is not function)
        name = dotted_name(model)
        is_new = any(is_bound(n) and dotted_name(n) == name for n in nodes_inside(function))
        return steps_elsewhere and not is_new
    for each in iterations(script, reset):
        end = (each.inside if each.functions else settling).end_lineno or 0
        after = (n for n in nodes_inside(each.loop) if isinstance(n, ast.stmt) and n.lineno > end)
        is_same = names_in(each.inside).isdisjoint(each.varying_names(script))
        if is_same and not each.makes_model() and any(map(script.steps_either_inside, after)):
            return True
    return False
