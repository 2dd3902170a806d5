"""A stepping loop with a habit in it, compiled as a careful user would have written it."""

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.loop.habits import Habit
from mjbench.simulation import compat
from mjbench.simulation.workload import reset_to_start, start_data

Start = Callable[[mujoco.MjModel, mujoco.MjData], None]


def loop_names(
    model: mujoco.MjModel, nstep: int, file: str, start: Start = reset_to_start
) -> dict[str, Any]:
    """Return the names that a habit's snippets may use, by their spelling.

    `joint_id` is the first joint that has a name, and 0 if none has. A snippet may assign another
    MjData to `data`.
    """
    joints = [model.joint(i).name for i in range(model.njnt)]
    joint_id = next((i for i, name in enumerate(joints) if name), 0)
    return {
        "mujoco": mujoco,
        "np": np,
        "mj_step": mujoco.mj_step,
        "start": start,
        "model": model,
        "data": start_data(model),
        "nstep": nstep,
        "spec": compat.INTEGRATION,
        "joint_id": joint_id,
        "joint_name": joints[joint_id],
        "file": file,
    }


@dataclass(frozen=True)
class CompiledLoop:
    """A stepping loop with a habit in it.

    Attributes:
      run: resets to the start state, then steps nstep times.
      value: returns what the habit computed in the last step.
    """

    run: Callable[[], None]
    value: Callable[[], Any]


# The snippets run inside functions, so that every name is a local of `make`: a global costs a
# dictionary lookup, which would count as the habit's. `run` may assign `data` (a new MjData per
# episode), and `value` must then see the new one: hence `nonlocal`.
_PROGRAM = """\
def make({names}):
{setup}
    def run():
        nonlocal data
{before_run}
        start(model, data)
{steps}
{after_run}
    def value():
        i = nstep - 1
        return {value}
    return run, value, locals()
"""


def compile_loop(
    habit: Habit,
    model: mujoco.MjModel,
    nstep: int,
    file: str = "",
    start: Start = reset_to_start,
) -> CompiledLoop:
    """Return the loop with a habit in it, of `nstep` steps from where `start` brings an MjData.

    Habits that need the model's spec need the path of its file.
    """
    names = loop_names(model, nstep, file, start)
    text = _PROGRAM.format(
        names=", ".join(names),
        setup=textwrap.indent(habit.setup, " " * 4),
        before_run=textwrap.indent(habit.before_run, " " * 8),
        steps=textwrap.indent(_steps(habit), " " * 8),
        after_run=textwrap.indent(habit.after_run, " " * 8),
        value=habit.value or habit.body,
    )
    namespace: dict[str, Any] = {}
    exec(compile(text, f"<{habit.name}>", "exec"), namespace)
    run, value, loop_locals = namespace["make"](**names)
    # A view such as `robot.joints` does not keep its spec alive; in a script, the script's own
    # names do. Here the function does.
    run.keeps_alive = loop_locals
    return CompiledLoop(run, value)


def script(habit: Habit) -> str:
    """Return the loop as lines of a script in which the `loop_names` are defined."""
    parts = (habit.setup, habit.before_run, _steps(habit), habit.after_run)
    return "\n".join(part for part in parts if part)


def _steps(habit: Habit) -> str:
    if habit.instead_of_loop:
        return habit.instead_of_loop
    return f"for i in range(nstep):\n    mj_step(model, data)\n    {habit.body}"
