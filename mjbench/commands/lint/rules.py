"""The rules of `mjbench lint`: those about what runs in each step or episode, and all of them.

A new rule is a function with its explanation, here or in another module of this package, and
a line of `RULES`.
"""

import ast
import re
from collections.abc import Iterator

from mjbench.commands.lint.contact_scans import COUNTS, contact_scans, names_contact
from mjbench.commands.lint.finite_differences import finite_differences
from mjbench.commands.lint.forward import forward_after_step
from mjbench.commands.lint.growing_arrays import growing_arrays
from mjbench.commands.lint.moments import rows_of_two_moments
from mjbench.commands.lint.new_objects import (
    compiled_models,
    copied_data,
    new_data_per_episode,
    new_device_copies,
    new_jitted_functions,
    new_renderers,
    new_rollout_pools,
)
from mjbench.commands.lint.repeats import in_steps
from mjbench.commands.lint.restarts import serial_simulations, settled_resets
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    attributes_in,
    dotted_name,
    is_call,
    is_numpy_call,
    is_step,
    last_name,
    names_in,
    nodes_inside,
)
from mjbench.commands.lint.stepping_script import STORING_METHODS, SteppingScript
from mjbench.commands.lint.stored_views import stored_views
from mjbench.commands.lint.wrong_results import halves_of_runge_kutta, shared_data, written_views
from mjbench.errors import InputError

# The codes of the rules on views that outlive their step, on names looked up in every step, and on
# arrays created in every step.
STORED_VIEW, NAMED_ACCESS, NEW_ARRAY = "MJB001", "MJB002", "MJB003"
# About how many ns a habit of commands/profile/habits.py adds to a step of the cart-pole, as stored
# in results/overhead.json; on another machine, only the order of magnitude is the same.
COSTS_NS = {
    "named access by name": 1316.000330677059,
    "allocate zeros": 315.11347004333663,
    "concatenate": 1209.4139383725874,
    "hstack": 3636.139767674077,
}
# Functions of NumPy that allocate an array, with the habit that costs about as much.
_CREATE = (
    *("zeros", "ones", "empty", "full", "zeros_like", "ones_like", "empty_like", "array", "eye"),
)
ALLOCATIONS = {
    **dict.fromkeys(_CREATE, "allocate zeros"),
    **dict.fromkeys(("concatenate", "append", "tile"), "concatenate"),
    **dict.fromkeys(("hstack", "vstack", "stack"), "hstack"),
}
# Calls that wait, or read a clock.
_KEEPS_RATE = re.compile(r"sleep|wait|tick|time|clock|pause|perf_counter|monotonic|rate|input")


@rule(
    STORED_VIEW,
    "a view is stored: every entry will show the last state; add .copy()",
    is_wrong_result=True,
)
def logged_views(script: SteppingScript) -> Iterator[Match]:
    """Yield views that outlive the iteration in which they were taken.

    `data.qpos` is a view: an array that shows the memory of the MjData. Storing it stores no
    values, so every entry shows the state of the last step, and `np.array(log)` has the same row
    everywhere. This holds for the fields of an MjData, for their slices and reshapes, and for those
    of named parts; also where a function of the script returns or yields the view.

        mujoco.mj_step(model, data)
        log.append(data.qpos)           # write: log.append(data.qpos.copy())

    Results: the log holds one row for each step. The simulation stays as it is, unless the program
    steps from what it reads in the log, be it as text (`str`, `repr`, `format`).
    """
    return stored_views(script).matches()


@rule(
    NAMED_ACCESS,
    "named access inside a stepping loop; hoist it: x = data.joint('x').qpos before the loop",
)
def named_access(script: SteppingScript) -> Iterator[Match]:
    """Yield calls that look a name up in every step.

    `data.joint("hip")` looks the name up each time. MuJoCo keeps one object for each element, whose
    arrays are views, so the object from before the loop shows the present values in every step.

        for _ in range(1000):
            mujoco.mj_step(model, data)
            angle = data.joint("hip").qpos[0]

        hip = data.joint("hip")         # instead
        for _ in range(1000):
            mujoco.mj_step(model, data)
            angle = hip.qpos[0]

    There is no finding for names of contacts, which are others in each step.

    Results: none change. A wrong name raises before the loop.
    """
    calls = [c for c in script.calls if script.is_named_access(c) or is_call(c, "mj_name2id")]
    loops = [*script.loops, *script.environment_loops]
    for call, each in in_steps(script, calls, loops):
        scope = each.functions[-1] if each.functions else each.loop
        if not names_contact(script, call, scope):
            yield Match(call, COSTS_NS["named access by name"], loop=each.calling_loop)


@rule(
    NEW_ARRAY,
    "a new array in every step; create one before the loop and write into its slices (x[:n] =)",
)
def allocations(script: SteppingScript) -> Iterator[Match]:
    """Yield calls that allocate an array of the same size in every step.

    Each call allocates an array and fills it; in a small model this costs as much as part of a
    step.

        observation = np.concatenate([data.qpos, data.qvel])

        observation = np.empty(model.nq + model.nv)       # instead, before the loop
        observation[: model.nq] = data.qpos
        observation[model.nq :] = data.qvel

    There is no finding under an `if`, which may run only once, where the number of contacts or
    constraints is the size, or where the array is appended to a list.

    Results: none change, unless the program keeps the arrays: then it needs one for each step.
    """
    growing = {match.node for match in growing_arrays.matches(script)}
    arrays = [
        call
        for call in script.calls
        if is_call(call, *ALLOCATIONS)
        and is_numpy_call(call)
        and not any(keyword.arg == "out" for keyword in call.keywords)
        and growing.isdisjoint([call, *script.above(call)])  # they go with it
        and attributes_in(call).isdisjoint({*COUNTS, "contact"})
        and not is_call(script.parents[call], *STORING_METHODS)
    ]
    for call, each in in_steps(script, arrays, script.loops):
        if not script.is_conditional(call):
            cost = COSTS_NS[ALLOCATIONS[last_name(call.func)]]
            yield Match(call, cost, loop=each.calling_loop)


@rule(
    "MJB017",
    "nothing happens between these steps: take them in one call, mj_step(model, data, nstep)",
)
def steps_in_a_row(script: SteppingScript) -> Iterator[Match]:
    """Yield calls of mj_step that a loop does nothing but repeat, a given number of times.

    Each call of `mj_step` passes from Python to C and back. Where nothing is read or written
    between steps, as while an action is held, one call takes them all.

        data.ctrl[:] = policy(data)
        for _ in range(frame_skip):
            mujoco.mj_step(model, data)

        data.ctrl[:] = policy(data)     # instead
        mujoco.mj_step(model, data, frame_skip)

    There is no finding where the loop does anything else, such as to ask the policy.

    Results: none change, bit for bit.
    """
    for call in script.calls:
        statement = script.parents[call]
        loop = script.parents.get(statement)
        if not isinstance(loop, ast.For) or loop.body != [statement] or loop.orelse:
            continue
        is_range = isinstance(loop.iter, ast.Call) and dotted_name(loop.iter.func) == "range"
        inner = [n for n in ast.walk(statement) if isinstance(n, ast.Call)]
        is_plain = is_call(call, "mj_step") and len(call.args) == 2 and not call.keywords
        is_same_step = names_in(loop.target).isdisjoint(names_in(call))
        if is_range and is_plain and inner == [call] and is_same_step:
            yield Match(call)


@rule(
    "MJB021", "the viewer gets every step, which no screen can show; sync about 60 times a second"
)
def synced_viewers(script: SteppingScript) -> Iterator[Match]:
    """Yield viewer.sync() in every step of a loop that keeps no rate.

    `sync` waits for the thread that draws, and copies the state for it. With a timestep of 2 ms, a
    simulated second has 500 steps, and a screen shows 60 frames.

        while viewer.is_running():
            mujoco.mj_step(model, data)
            viewer.sync()

        while viewer.is_running():      # instead
            mujoco.mj_step(model, data)
            if time.perf_counter() - synced > 1 / 60:
                synced = time.perf_counter()
                viewer.sync()

    There is no finding where the loop sleeps, waits or reads a clock, takes several steps in an
    iteration, or syncs under a condition.

    Results: none change; what the user drags in the viewer takes effect at each `sync`.
    """
    viewers = {dotted_name(t) for t, v in script.values.items() if is_call(v, "launch_passive")}
    syncs = [call for call in script.calls if is_call(call, "sync")]
    of_viewers = [c for c in syncs if dotted_name(c.func).removesuffix(".sync") in viewers - {""}]
    for call, each in in_steps(script, of_viewers, script.loops):
        if not script.is_conditional(call) and _takes_single_steps(script, each.loop):
            yield Match(call, loop=each.calling_loop)


def _takes_single_steps(script: SteppingScript, loop: ast.AST) -> bool:
    """Return whether a loop takes one step in each iteration, and keeps no rate."""
    body = [node for statement in getattr(loop, "body", []) for node in ast.walk(statement)]
    calls = [node for node in body if isinstance(node, ast.Call)]
    called = [n for call in calls for f in script.functions.called(call) for n in nodes_inside(f)]
    calls += [node for node in called if isinstance(node, ast.Call)]
    steps = [call for call in calls if is_step(call)]
    is_single = len(steps) == 1 and len(steps[0].args) == 2 and not steps[0].keywords
    is_inner = any(isinstance(node, ast.For | ast.While) for node in (*body, *called))
    return (
        is_single and not is_inner and not any(_KEEPS_RATE.search(last_name(c.func)) for c in calls)
    )


RULES = (
    logged_views,
    named_access,
    allocations,
    new_data_per_episode,
    serial_simulations,
    forward_after_step,
    halves_of_runge_kutta,
    shared_data,
    copied_data,
    compiled_models,
    new_renderers,
    new_jitted_functions,
    new_rollout_pools,
    rows_of_two_moments,
    written_views,
    steps_in_a_row,
    growing_arrays,
    contact_scans,
    finite_differences,
    synced_viewers,
    new_device_copies,
    settled_resets,
)


def explained(code: str) -> str:
    """Return what a rule finds, why, and what to write instead; for `all`, what each finds."""
    if code.lower() == "all":
        return "".join(f"{each.title}\n" for each in RULES)
    for each in RULES:
        if each.code == code.upper():
            return f"{each.title}\n\n{each.explanation}"
    raise InputError(f"no rule {code!r}; there are {', '.join(each.code for each in RULES)}")
