"""The rules of `mjbench lint`: what each one looks for in a stepping script.

A new rule is a function that yields matches, and a line of `RULES`.
"""

import ast
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mjbench.loop import lint_explanations as explanations
from mjbench.loop.lint_forward import forward_after_step
from mjbench.loop.lint_match import Match
from mjbench.loop.lint_moments import rows_of_two_moments
from mjbench.loop.lint_new_objects import (
    compiled_models,
    copied_data,
    new_jitted_functions,
    new_renderers,
    new_rollout_pools,
)
from mjbench.loop.lint_repeats import Loop, names_in, step_loop_of_helper
from mjbench.loop.lint_written_views import written_views
from mjbench.loop.lint_wrong_results import halves_of_runge_kutta, shared_data
from mjbench.loop.script_names import dotted_name, last_name
from mjbench.loop.stepping_script import SteppingLoop, SteppingScript
from mjbench.loop.stored_views import stored_views

# The codes of the rules on views that outlive their step, and on names looked up in every step.
STORED_VIEW, NAMED_ACCESS = "MJB001", "MJB002"
# Habits of the overhead table (mjbench/loop/habits.py) by which rules say what a match costs.
NAMED_ACCESS_HABIT = "named access by name"
# Functions of NumPy that allocate an array, with the habit that costs about as much.
_CREATE = (
    "zeros",
    "ones",
    "empty",
    "full",
    "zeros_like",
    "ones_like",
    "empty_like",
    "array",
    "eye",
)
ALLOCATION_HABITS = {
    **dict.fromkeys(_CREATE, "allocate zeros"),
    **dict.fromkeys(("concatenate", "append", "tile"), "concatenate"),
    **dict.fromkeys(("hstack", "vstack", "stack"), "hstack"),
}
# Calls that begin an episode.
_EPISODE_STARTS = {"mj_resetData", "mj_resetDataKeyframe", "mj_setState", "MjData"}


@dataclass(frozen=True)
class Rule:
    """What is looked for.

    Attributes:
      code: as in `# noqa: MJB001`.
      message: what is wrong, and what to write instead.
      matches: yields the nodes of a script that break the rule.
      explanation: what happens, why, what to write instead, and what that changes in results.
      is_wrong_result: whether the program computes or records something else than it says; the
        other rules are about time.
    """

    code: str
    message: str
    matches: Callable[[SteppingScript], Iterator[Match]]
    explanation: str
    is_wrong_result: bool = False


def _returned(view: ast.expr) -> Match:
    """Return the match of a view in the function that returns or yields it."""
    return Match(
        view,
        message="a view is returned, and the caller stores it: every entry will show the last"
        " state; add .copy()",
    )


def _stored_views(script: SteppingScript) -> Iterator[Match]:
    """Yield views that outlive the iteration in which they were taken."""
    for stored in stored_views(script).all():
        yield _returned(stored.view) if stored.is_returned else Match(stored.view)


def _named_access(script: SteppingScript) -> Iterator[Match]:
    """Yield calls that look a name up in every step."""
    names = [
        call
        for call in script.calls
        if script.is_named_access(call) or last_name(call.func) == "mj_name2id"
    ]
    loops = [*script.loops, *script.environment_loops]
    for call, loop in _in_steps(script, names, loops):
        yield Match(call, NAMED_ACCESS_HABIT, loop=loop)


def _allocations(script: SteppingScript) -> Iterator[Match]:
    """Yield calls that allocate an array; not those under an `if`, which may run only once."""
    arrays = [
        call
        for call in script.calls
        if last_name(call.func) in ALLOCATION_HABITS
        and script.is_numpy_call(call)
        and not any(keyword.arg == "out" for keyword in call.keywords)
    ]
    for call, loop in _in_steps(script, arrays, script.loops):
        if not script.is_conditional(call):
            yield Match(call, ALLOCATION_HABITS[last_name(call.func)], loop=loop)


def _in_steps(
    script: SteppingScript, calls: Sequence[ast.Call], loops: Sequence[SteppingLoop]
) -> Iterator[tuple[ast.Call, Loop | None]]:
    """Yield calls that run in every step of one of some loops.

    With a call in a function comes the loop that calls the function; None with those of the loop.
    """
    inside = {loop.node: {*loop.inner} for loop in loops}
    for call in calls:
        loop = script.step_loop_around(call)
        if loop in inside and call in inside[loop]:
            yield call, None
        elif (each := step_loop_of_helper(script, call)) is not None and each.loop in inside:
            yield call, each.loop


def _new_data_per_episode(script: SteppingScript) -> Iterator[Match]:
    """Yield each new MjData of an episode, but not one of a model that is new as well."""
    for loop in script.episode_loops:
        yield from (Match(node) for node in loop.inner if script.is_new_data(node, loop))


def _serial_simulations(script: SteppingScript) -> Iterator[Match]:
    """Yield loops that begin a simulation in each iteration, and step it in a loop inside."""
    for loop in script.episode_loops:
        begins = any(
            isinstance(node, ast.Call) and last_name(node.func) in _EPISODE_STARTS
            for node in loop.inner
        )
        if begins and any(script.is_for_over_steps(node) for node in loop.inner):
            yield Match(loop.node)


def _steps_in_a_row(script: SteppingScript) -> Iterator[Match]:
    """Yield calls of mj_step that a loop does nothing but repeat, a given number of times."""
    for call in script.calls:
        statement = script.parents[call]
        loop = script.parents.get(statement)
        if not isinstance(loop, ast.For) or loop.body != [statement] or loop.orelse:
            continue
        is_range = isinstance(loop.iter, ast.Call) and dotted_name(loop.iter.func) == "range"
        inner = [n for n in ast.walk(statement) if isinstance(n, ast.Call)]
        is_plain = last_name(call.func) == "mj_step" and len(call.args) == 2 and not call.keywords
        if not (is_range and is_plain and inner == [call]):
            continue
        if names_in(loop.target).isdisjoint(names_in(call)):
            yield Match(call, callee="mj_step")


RULES = (
    Rule(
        STORED_VIEW,
        "a view is stored: every entry will show the last state; add .copy()",
        _stored_views,
        explanations.STORED_VIEW,
        is_wrong_result=True,
    ),
    Rule(
        NAMED_ACCESS,
        "named access inside a stepping loop; hoist it: x = data.joint('x').qpos before the loop",
        _named_access,
        explanations.NAMED_ACCESS,
    ),
    Rule(
        "MJB003",
        "a new array in every step; create one before the loop and write into its slices (x[:n] =)",
        _allocations,
        explanations.NEW_ARRAY,
    ),
    Rule(
        "MJB005",
        "a new MjData for every episode; create one and call mj_resetData",
        _new_data_per_episode,
        explanations.NEW_DATA,
    ),
    Rule(
        "MJB006",
        "a loop over simulations around a loop over steps; mujoco.rollout or mujoco.batch does both"
        " on threads (mjbench compare says which)",
        _serial_simulations,
        explanations.SERIAL_SIMULATIONS,
    ),
    Rule(
        "MJB007",
        "mj_forward after mj_step computes another step's worth, of which little is read",
        forward_after_step,
        explanations.FORWARD_AFTER_STEP,
    ),
    Rule(
        "MJB008",
        "mj_step2 integrates by Euler, but the model has the RK4 integrator; call mj_step",
        halves_of_runge_kutta,
        explanations.HALVES_OF_RUNGE_KUTTA,
        is_wrong_result=True,
    ),
    Rule(
        "MJB009",
        "several threads step one MjData and overwrite its state; create an MjData for each thread"
        " (they may share the model)",
        shared_data,
        explanations.SHARED_DATA,
        is_wrong_result=True,
    ),
    Rule(
        "MJB010",
        "a new MjData in every iteration; create one before the loop, and set it by mj_copyData,"
        " mj_setState or mj_resetData",
        copied_data,
        explanations.COPIED_DATA,
    ),
    Rule(
        "MJB011",
        "a model is compiled in every iteration; compile it once, and change the values of the"
        " compiled model",
        compiled_models,
        explanations.COMPILED_MODEL,
    ),
    Rule(
        "MJB012",
        "a new Renderer in every iteration; create one before the loop, and close it after",
        new_renderers,
        explanations.NEW_RENDERER,
    ),
    Rule(
        "MJB013",
        "jax.jit of a function that is new in every iteration traces and compiles each time; jit"
        " one function before the loop, and pass it what varies",
        new_jitted_functions,
        explanations.NEW_JITTED_FUNCTION,
    ),
    Rule(
        "MJB014",
        "rollout starts its threads anew in every iteration; keep a rollout.Rollout(nthread=…)"
        " open, or pass persistent_pool=True",
        new_rollout_pools,
        explanations.NEW_ROLLOUT_POOL,
    ),
    Rule(
        "MJB015",
        "a row mixes the new state with what is still computed from the one before",
        rows_of_two_moments,
        explanations.ROW_OF_TWO_MOMENTS,
        is_wrong_result=True,
    ),
    Rule(
        "MJB016",
        "this writes into the simulation, through a view that a function returns; copy it",
        written_views,
        explanations.WRITTEN_VIEW,
        is_wrong_result=True,
    ),
    Rule(
        "MJB017",
        "nothing happens between these steps: take them in one call, mj_step(model, data, nstep)",
        _steps_in_a_row,
        explanations.STEPS_IN_A_ROW,
    ),
)
