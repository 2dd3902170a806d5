"""What a Python loop adds to `mj_step`: each habit as a snippet inside a stepping loop.

A snippet is real code. It runs after `mj_step` in every turn of the loop, because beside a step
an operation costs more than alone: its memory is no longer in the cache. Its cost is the loop's
time less the bare loop's.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.simulation import compat
from mjbench.simulation.workload import reset_to_start


@dataclass(frozen=True)
class Habit:
    """One habit.

    Attributes:
      name: what it is called.
      inside: statement of the loop's body, after the step.
      before: statements before the loop.
      cheaper: name of the source that does the same for less; empty where there is none.
      value: expression of what it computed, evaluated after the last step; by default `inside`.
      needs: expression that says whether this release and model have what it needs.
      around: statements right before and after the loop, each time it runs. An episode is one run
        of the loop; every run begins at the start state, whatever the source does.
      steps: what steps, where it is not a loop.
    """

    name: str
    inside: str
    before: str = ""
    cheaper: str = ""
    value: str = ""
    needs: str = "True"
    around: tuple[str, str] = ("pass", "pass")
    steps: str = ""


BARE = Habit("bare loop", "pass", value="None")
_ROW = "row = np.empty(model.nq + model.nv)"
_BOTH = "qpos, qvel = data.qpos, data.qvel"
# The model's joints as elements of the spec it is compiled from, to which values can be bound.
_BIND = (
    "robot = mujoco.MjSpec.from_file(file)\nmodel = robot.compile()\ndata = mujoco.MjData(model)\n"
    "joints = robot.joints"
)
_BINDS = "hasattr(mujoco.MjData, 'bind') and file.endswith('.xml')"
HABITS = (
    BARE,
    Habit(
        "named access by name",
        "data.joint(joint_name).qpos",
        cheaper="hoisted accessor",
        needs="joint_name",
    ),
    Habit("named access by id", "data.joint(joint_id).qpos", cheaper="hoisted accessor"),
    Habit(
        "hoisted accessor",
        "joint.qpos",
        "joint = data.joint(joint_id)",
        cheaper="hoisted joint view",
    ),
    Habit(
        "hoisted view",
        "qpos[0]",
        "qpos = data.joint(joint_id).qpos",
    ),
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
        around=("rows.clear()", "pass"),
    ),
    Habit("allocate zeros", "np.zeros(model_nv)", "model_nv = model.nv", cheaper="zeros in place"),
    Habit("zeros in place", "row.fill(0.0)", "row = np.empty(model.nv)", value="row"),
    Habit(
        "concatenate",
        "np.concatenate((qpos, qvel))",
        _BOTH,
        cheaper="concatenate into array",
    ),
    Habit("hstack", "np.hstack((qpos, qvel))", _BOTH, cheaper="concatenate into array"),
    Habit(
        "concatenate into array",
        "np.concatenate((qpos, qvel), out=row)",
        f"{_BOTH}\n{_ROW}",
    ),
    Habit("control element", "data.ctrl[0] = 0.1", value="data.ctrl", needs="model.nu"),
    Habit(
        "control slice",
        "data.ctrl[:1] = control",
        "control = np.array(data.ctrl[:1])",
        value="data.ctrl",
        needs="model.nu",
    ),
    Habit(
        "control whole",
        "data.ctrl[:] = control",
        "control = np.array(data.ctrl)",
        cheaper="control hoisted",
        value="data.ctrl",
        needs="model.nu",
    ),
    Habit(
        "control by assignment",
        "data.ctrl = control",
        "control = np.array(data.ctrl)",
        cheaper="control hoisted",
        value="data.ctrl",
        needs="model.nu",
    ),
    Habit(
        "control by accessor",
        "data.actuator(0).ctrl = control",
        "control = np.array(data.actuator(0).ctrl)",
        cheaper="control hoisted",
        value="data.ctrl",
        needs="model.nu",
    ),
    Habit(
        "control hoisted",
        "ctrl[:] = control",
        "ctrl = data.ctrl\ncontrol = np.array(data.ctrl)",
        value="data.ctrl",
        needs="model.nu",
    ),
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
    Habit("dict lookup", "fields['qpos']", "fields = {'qpos': data.qpos}", cheaper="hoisted qpos"),
    Habit(
        "callback from Python",
        "pass",
        value="None",
        around=("mujoco.set_mjcb_control(lambda m, d: None)", "mujoco.set_mjcb_control(None)"),
    ),
    Habit("bind in the loop", "data.bind(joints).qpos", _BIND, "bind hoisted", needs=_BINDS),
    Habit("bind hoisted", "bound.qpos", f"{_BIND}\nbound = data.bind(joints)", needs=_BINDS),
    Habit(
        "new MjData per episode",
        "pass",
        cheaper="reset per episode",
        value="data.time",
        around=("nonlocal data\ndata = mujoco.MjData(model)", "pass"),
    ),
    Habit(
        "reset per episode",
        "pass",
        value="data.time",
        around=("mujoco.mj_resetData(model, data)", "pass"),
    ),
    Habit(
        "engine clock off",
        "pass",
        "import ctypes\nprototype = ctypes.CFUNCTYPE(ctypes.c_double)\n"
        "no_clock = ctypes.cast(ctypes.CDLL(None).difftime, prototype)",
        value="data.time",
        needs="has_clock(model)",
        around=("mujoco.set_mjcb_time(no_clock)", "mujoco.set_mjcb_time(None)"),
    ),
    Habit("call of zero steps", "mj_step(model, data, 0)", value="None"),
    Habit("one call for all steps", "pass", value="data.time", steps="mj_step(model, data, nstep)"),
)

_LOOP = """\
def loop():
    {first}
    start(model, data)
    {steps}
    {last}
def value():
    i = nstep - 1
    return {value}
"""


@dataclass(frozen=True)
class Loop:
    """A loop with a source inside, compiled.

    Attributes:
      run: resets, then steps nstep times.
      value: what the source computed in the last step.
    """

    run: Callable[[], None]
    value: Callable[[], Any]


def find(name: str) -> Habit:
    """Return the source called `name`; KeyError if there is none."""
    return {source.name: source for source in HABITS}[name]


def available(source: Habit, model: Any, file: str = "") -> bool:
    """Return whether this release, model, and the file it is from have what a source needs."""
    names = {"mujoco": mujoco, "model": model, "file": file, "has_clock": compat.has_clock}
    return bool(eval(source.needs, names | {"joint_name": _joint(model)[1]}))


def _joint(model: Any) -> tuple[int, str]:
    """Return number and name of the first joint that has a name; of the first one if none has."""
    names = [model.joint(i).name for i in range(model.njnt)]
    number = next((i for i, name in enumerate(names) if name), 0)
    return number, names[number]


def code(source: Habit) -> str:
    """Return the source as a script that starts from `model`, `data`, `nstep` and the like."""
    first, last = (
        [line for line in part.splitlines() if line != "pass" and not line.startswith("nonlocal")]
        for part in source.around
    )
    return "\n".join([*source.before.splitlines(), *first, *_steps(source), *last])


def _steps(source: Habit) -> list[str]:
    if source.steps:
        return [source.steps]
    return ["for i in range(nstep):", "    mj_step(model, data)", f"    {source.inside}"]


def loop(source: Habit, model: Any, nstep: int, file: str = "") -> Loop:
    """Compile the loop with a source inside.

    Every name the snippet uses is local to it, as in a function that a careful user writes.

    Args:
      source: what is inside.
      model: the MjModel.
      nstep: steps of the loop.
      file: that the model is from, for sources that need its spec.
    """
    text = _LOOP.format(
        first=source.around[0].replace("\n", "\n    "),
        steps="\n    ".join(_steps(source)),
        last=source.around[1],
        value=source.value or source.inside,
    )
    body = "\n".join(
        [
            "def make(mujoco, np, model, data, nstep, spec, joint_id, joint_name, mj_step, start,",
            "         file):",
            *(f"    {line}" for line in source.before.splitlines()),
            *(f"    {line}" for line in text.splitlines()),
            "    return loop, value, locals()",
        ]
    )
    found: dict[str, Any] = {}
    exec(compile(body, f"<{source.name}>", "exec"), found)
    data = mujoco.MjData(model)
    reset_to_start(model, data)
    spec = compat.state_spec("INTEGRATION")
    joint_id, joint_name = _joint(model)
    step, start = mujoco.mj_step, reset_to_start
    run, value, names = found["make"](
        mujoco, np, model, data, nstep, spec, joint_id, joint_name, step, start, file
    )
    run.names = names  # lives as long as the loop, as a script's names do: views need their spec
    return Loop(run, value)
