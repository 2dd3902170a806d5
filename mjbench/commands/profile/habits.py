"""The habits of a Python loop around `mj_step` whose cost is measured: one table, and their loops.

Each habit is real code that runs after `mj_step` in every iteration of a stepping loop. There an
operation costs more than alone, because the step has evicted its memory from the cache. A habit's
cost is the time of the loop with it less the time of the bare loop.
"""

import functools
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.simulation import compat, engine_clock
from mjbench.simulation.workload import reset_to_start, start_data

Start = Callable[[mujoco.MjModel, mujoco.MjData], None]


@dataclass(frozen=True)
class Habit:
    """One habit, as snippets of a loop.

    A run of the loop is an episode: it starts from the start state, whatever the habit does.
    Snippets may use the names of `loop_names`, and those that `setup` defines.

    Attributes:
      setup: statements that run once, before the first run of the loop; `before_run` and
        `after_run` are in each run of it.
      cheaper: name of the habit that does the same for less; empty if there is none.
      value: expression for what the habit computed, evaluated after the last step; `body` if
        empty.
      requires: whether this MuJoCo release, the model and the file it was loaded from have what
        the habit needs.
      instead_of_loop: statement that does all steps of a run; a loop with `body` if empty.
    """

    name: str
    body: str
    setup: str = ""
    cheaper: str = ""
    value: str = ""
    requires: Callable[[mujoco.MjModel, str], bool] = lambda model, file: True
    before_run: str = ""
    after_run: str = ""
    instead_of_loop: str = ""


def _has_bind(model: mujoco.MjModel, file: str) -> bool:
    return compat.has_bind() and file.endswith(".xml")


BARE = Habit("bare loop", "pass", value="None")
# The two parts of the bare loop: the binding, as a call that steps nothing, and the engine, as one
# call for all steps. They are measured like habits; the table of costs leaves the first one out.
ZERO_STEPS = Habit("call of zero steps", "mj_step(model, data, 0)", value="None")
ONE_CALL = Habit(
    "one call for all steps",
    "pass",
    value="data.time",
    instead_of_loop="mj_step(model, data, nstep)",
)
# A step reads the timer of MuJoCo's Python package around each stage.
CLOCK_OFF = Habit(
    "timer off",
    "pass",
    "import mjbench",
    value="data.time",
    requires=lambda model, file: engine_clock.has_clock(model),
    before_run="mjbench.engine_clock(False)",
    after_run="mjbench.engine_clock(True)",
)

_control_habit = functools.partial(
    Habit, value="data.ctrl", requires=lambda model, file: bool(model.nu)
)
_CONTROL = "control = np.array(data.ctrl)"
_QPOS_QVEL = "qpos, qvel = data.qpos, data.qvel"
_QPOS_QVEL_ROW = f"{_QPOS_QVEL}\nrow = np.empty(model.nq + model.nv)"
_SLICES = "slices of an array"
# The joints as elements of the model's spec, which is what `MjData.bind` takes.
_BIND = (
    "robot = mujoco.MjSpec.from_file(file)\nmodel = robot.compile()\ndata = mujoco.MjData(model)\n"
    "joints = robot.joints"
)

HABITS = (
    BARE,
    Habit(
        "named access by name",
        "data.joint(joint_name).qpos",
        cheaper="hoisted accessor",
        requires=lambda model, file: any(model.joint(i).name for i in range(model.njnt)),
    ),
    Habit("named access by id", "data.joint(joint_id).qpos", cheaper="hoisted accessor"),
    Habit("hoisted accessor", "joint.qpos", "joint = data.joint(joint_id)", "hoisted joint view"),
    Habit("hoisted view", "qpos[0]", "qpos = data.joint(joint_id).qpos"),
    Habit("hoisted joint view", "qpos", "qpos = data.joint(joint_id).qpos"),
    Habit("attribute qpos", "data.qpos", cheaper="hoisted qpos"),
    Habit("hoisted qpos", "qpos", "qpos = data.qpos"),
    Habit("attribute time", "data.time"),
    Habit("attribute opt.timestep", "model.opt.timestep", cheaper="hoisted timestep"),
    Habit("hoisted timestep", "timestep", "timestep = model.opt.timestep"),
    Habit("copy", "qpos.copy()", "qpos = data.qpos"),
    Habit(
        "copy into array",
        "rows[i] = qpos",
        "qpos = data.qpos\nrows = np.empty((nstep, model.nq))",
        value="rows[nstep - 1]",
    ),
    Habit(
        "append copy to list",
        "rows.append(qpos.copy())",
        "qpos = data.qpos\nrows = []",
        cheaper="copy into array",
        value="rows[nstep - 1]",
        before_run="rows.clear()",
    ),
    Habit("allocate zeros", "np.zeros(model_nv)", "model_nv = model.nv", cheaper="zeros in place"),
    Habit("zeros in place", "row.fill(0.0)", "row = np.empty(model.nv)", value="row"),
    Habit("concatenate", "np.concatenate((qpos, qvel))", _QPOS_QVEL, _SLICES),
    Habit("hstack", "np.hstack((qpos, qvel))", _QPOS_QVEL, _SLICES),
    Habit(
        "concatenate into array", "np.concatenate((qpos, qvel), out=row)", _QPOS_QVEL_ROW, _SLICES
    ),
    Habit(
        _SLICES, "row[:nq] = qpos; row[nq:] = qvel", f"{_QPOS_QVEL_ROW}\nnq = model.nq", value="row"
    ),
    _control_habit("control element", "data.ctrl[0] = 0.1"),
    _control_habit("control slice", "data.ctrl[:1] = control", "control = np.array(data.ctrl[:1])"),
    _control_habit("control whole", "data.ctrl[:] = control", _CONTROL, "control hoisted"),
    _control_habit("control by assignment", "data.ctrl = control", _CONTROL, "control hoisted"),
    _control_habit(
        "control by accessor",
        "data.actuator(0).ctrl = control",
        "control = np.array(data.actuator(0).ctrl)",
        "control hoisted",
    ),
    _control_habit("control hoisted", "ctrl[:] = control", f"ctrl = data.ctrl\n{_CONTROL}"),
    Habit(
        "state get",
        "mujoco.mj_getState(model, data, state, spec)",
        "state = np.empty(mujoco.mj_stateSize(model, spec))",
        value="state",
    ),
    Habit(
        "state set",
        "mujoco.mj_setState(model, data, state, spec)",
        "state = np.empty(mujoco.mj_stateSize(model, spec))\n"
        "mujoco.mj_getState(model, data, state, spec)",
        value="data.qpos",
    ),
    Habit("dict lookup", "fields['qpos']", "fields = {'qpos': data.qpos}", "hoisted qpos"),
    Habit(
        "callback from Python",
        "pass",
        value="None",
        before_run="mujoco.set_mjcb_control(lambda m, d: None)",
        after_run="mujoco.set_mjcb_control(None)",
    ),
    Habit("bind in the loop", "data.bind(joints).qpos", _BIND, "bind hoisted", requires=_has_bind),
    Habit("bind hoisted", "bound.qpos", f"{_BIND}\nbound = data.bind(joints)", requires=_has_bind),
    Habit(
        "new MjData per episode",
        "pass",
        cheaper="reset per episode",
        value="data.time",
        before_run="data = mujoco.MjData(model)",
    ),
    Habit(
        "reset per episode",
        "pass",
        value="data.time",
        before_run="mujoco.mj_resetData(model, data)",
    ),
    CLOCK_OFF,
    ZERO_STEPS,
    ONE_CALL,
)
BY_NAME = {habit.name: habit for habit in HABITS}


def loop_names(
    model: mujoco.MjModel, nstep: int, file: str, start: Start = reset_to_start
) -> dict[str, Any]:
    """Return the names that a habit's snippets may use; `joint_id` is a joint with a name, or 0."""
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
    """A stepping loop with a habit in it; `value` returns what that computed in the last step."""

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
    habit: Habit, model: mujoco.MjModel, nstep: int, file: str = "", start: Start = reset_to_start
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
