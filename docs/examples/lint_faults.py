"""Show that what each rule of `mjbench lint` reports is a fault.

    python lint_faults.py [CODE …]

Needs mujoco and NumPy only. Each line has the fault first, then what to write instead.
"""

import sys
import timeit

import mujoco
import numpy as np

PENDULUM = """
<mujoco>
  <worldbody>
    <body name="arm">
      <joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
    </body>
  </worldbody>
</mujoco>
"""


def stored_view() -> str:
    """MJB001: all entries of a list of views are the last state; copies are one state each."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    views, copies = [], []
    for _ in range(100):
        mujoco.mj_step(model, data)
        views.append(data.qpos)
        copies.append(data.qpos.copy())
    return f"different states in 100 steps: {_distinct(views)} views, {_distinct(copies)} copies"


def named_access() -> str:
    """MJB002: a name is looked up in every step; its object can be looked up once."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    joint = data.joint("hinge")
    assert data.joint("hinge").qpos.ctypes.data == joint.qpos.ctypes.data
    inside = _ns(lambda: data.joint("hinge").qpos)
    hoisted = _ns(lambda: joint.qpos)
    return f"ns an access: {inside:.0f} by name, {hoisted:.0f} of an object from before the loop"


def new_array() -> str:
    """MJB003: an array is created in every step; one can be written again, slice by slice."""
    qpos, qvel, row = np.arange(30.0), np.arange(30.0), np.empty(60)

    def in_place() -> None:
        row[:30], row[30:] = qpos, qvel

    in_place()
    assert np.array_equal(row, np.hstack([qpos, qvel]))
    stacked = _ns(lambda: np.hstack([qpos, qvel]))
    joined = _ns(lambda: np.concatenate([qpos, qvel]))
    slices = _ns(in_place)
    return f"ns a row: {stacked:.0f} hstack, {joined:.0f} concatenate, {slices:.0f} into slices"


def new_data() -> str:
    """MJB005: an episode creates an MjData; mj_resetData leaves the same state."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = 1, 2
    mujoco.mj_resetData(model, data)
    fresh = mujoco.MjData(model)
    assert all(np.array_equal(getattr(data, f), getattr(fresh, f)) for f in ("qpos", "qvel", "act"))
    new = _ns(lambda: mujoco.MjData(model), 200)
    reset = _ns(lambda: mujoco.mj_resetData(model, data), 200)
    return f"ns an episode: {new:.0f} for MjData(model), {reset:.0f} for mj_resetData"


def one_after_another() -> str:
    """MJB006: simulations run in turn; rollout steps them together, to the same states."""
    try:
        from mujoco import rollout

        rollout.Rollout  # noqa: B018
    except (ImportError, AttributeError):
        return f"the rollout of MuJoCo {mujoco.__version__} has no threads"
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.zeros((64, mujoco.mj_stateSize(model, full)))
    starts[:, 1] = np.linspace(-1, 1, 64)  # qpos, after time

    def loop() -> np.ndarray:
        ends = np.empty((64, 2))
        for start, end in zip(starts, ends, strict=True):
            mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start, full)
            for _ in range(100):
                mujoco.mj_step(model, data)
            end[:] = data.qpos[0], data.qvel[0]
        return ends

    def together() -> np.ndarray:
        states, _ = rollout.rollout(model, data, starts, nstep=100)
        return np.asarray(states)[:, -1, 1:3]

    assert np.array_equal(loop(), together())
    one, all_ = _ns(loop, 1), _ns(together, 1)
    return f"ms for 64 runs of 100 steps: {one / 1e6:.1f} in a loop, {all_ / 1e6:.1f} by rollout"


FAULTS = {
    "MJB001": stored_view,
    "MJB002": named_access,
    "MJB003": new_array,
    "MJB005": new_data,
    "MJB006": one_after_another,
}


def _distinct(rows: list[np.ndarray]) -> int:
    return len({row.tobytes() for row in rows})


def _ns(call, number: int = 10_000) -> float:
    """Return the nanoseconds of a call: the fastest of five series."""
    return min(timeit.repeat(call, number=number, repeat=5)) / number * 1e9


if __name__ == "__main__":
    for code in sys.argv[1:] or FAULTS:
        print(code, FAULTS[code]())
