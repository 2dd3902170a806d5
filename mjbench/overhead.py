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

from mjbench import compat
from mjbench.workload import reset_to_start


@dataclass(frozen=True)
class Source:
    """One habit.

    Attributes:
      name: what it is called.
      inside: statement of the loop's body, after the step.
      before: statements before the loop.
    """

    name: str
    inside: str
    before: str = ""


BARE = Source("bare loop", "pass")
SOURCES = (
    BARE,
    Source("named access by name", "data.joint(joint_name).qpos"),
    Source("named access by id", "data.joint(0).qpos"),
    Source("hoisted accessor", "joint.qpos", "joint = data.joint(joint_name)"),
    Source("hoisted view", "qpos[0]", "qpos = data.joint(joint_name).qpos"),
    Source("attribute qpos", "data.qpos"),
    Source("attribute time", "data.time"),
    Source("attribute opt.timestep", "model.opt.timestep"),
    Source("copy", "qpos.copy()", "qpos = data.qpos"),
    Source(
        "copy into array",
        "rows[i] = qpos",
        "qpos = data.qpos\nrows = np.empty((nstep, model.nq))",
    ),
    Source("allocate zeros", "np.zeros(model_nv)", "model_nv = model.nv"),
    Source("concatenate", "np.concatenate((qpos, qvel))", "qpos, qvel = data.qpos, data.qvel"),
    Source(
        "concatenate into array",
        "np.concatenate((qpos, qvel), out=row)",
        "qpos, qvel = data.qpos, data.qvel\nrow = np.empty(model.nq + model.nv)",
    ),
    Source("control element", "data.ctrl[0] = 0.1"),
    Source("control whole", "data.ctrl[:] = control", "control = np.array(data.ctrl)"),
    Source(
        "control hoisted", "ctrl[:] = control", "ctrl = data.ctrl\ncontrol = np.array(data.ctrl)"
    ),
    Source(
        "state get",
        "mujoco.mj_getState(model, data, state, spec)",
        "state = np.empty(mujoco.mj_stateSize(model, spec))",
    ),
    Source(
        "state set",
        "mujoco.mj_setState(model, data, state, spec)",
        "state = np.empty(mujoco.mj_stateSize(model, spec))\n"
        "mujoco.mj_getState(model, data, state, spec)",
    ),
)

_LOOP = """\
def loop():
    for i in range(nstep):
        mj_step(model, data)
        {inside}
"""


def find(name: str) -> Source:
    """Return the source called `name`; KeyError if there is none."""
    return {source.name: source for source in SOURCES}[name]


def loop(source: Source, model: Any, nstep: int) -> Callable[[], None]:
    """Return a function that resets and then steps `model` nstep times with the snippet inside.

    Every name the snippet uses is local to it, as in a function that a careful user writes.
    """
    data = mujoco.MjData(model)
    body = "\n".join(
        [
            "def make(mujoco, np, model, data, nstep, spec, joint_name, mj_step):",
            *(f"    {line}" for line in source.before.splitlines()),
            *(f"    {line}" for line in _LOOP.format(inside=source.inside).splitlines()),
            "    return loop",
        ]
    )
    found: dict[str, Any] = {}
    exec(compile(body, f"<{source.name}>", "exec"), found)
    spec = compat.state_spec("INTEGRATION")
    joint_name = model.joint(0).name
    reset_to_start(model, data)
    run = found["make"](mujoco, np, model, data, nstep, spec, joint_name, mujoco.mj_step)

    def whole() -> None:
        reset_to_start(model, data)
        run()

    return whole
