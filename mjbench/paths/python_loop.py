"""The plain Python loop, one `mj_step` call per step or one per control."""

import mujoco

from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    SteppingPath,
    fill_from_array,
    needs_reset,
    simulate,
)
from mjbench.simulation.compat import state_spec
from mjbench.simulation.workload import Workload


class PythonLoop(SteppingPath):
    """`mj_step(model, data)` in a loop; what every speed-up is a speed-up over."""

    name = "python_loop"
    summary = "for loop over mj_step, one call per step"
    closed_loop = True

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        model, hold = workload.model, workload.hold
        (data,) = resources.datas(1)
        final_state = resources.final_state()
        spec, fresh = state_spec("INTEGRATION"), needs_reset(model)

        def run() -> None:
            mj_step, ctrl = mujoco.mj_step, data.ctrl
            for start, controls, end in zip(
                workload.initial_state, workload.control, final_state, strict=True
            ):
                if fresh:
                    mujoco.mj_resetData(model, data)
                mujoco.mj_setState(model, data, start, spec)
                for values in controls:
                    ctrl[:] = values
                    for _ in range(hold):
                        mj_step(model, data)
                mujoco.mj_getState(model, data, end, spec)

        return Prepared(run, *fill_from_array(final_state))

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        if workload.hold == 1:
            return _LOOP.format(step="        mujoco.mj_step(model, data)\n")
        repeat = f"        for _ in range({workload.hold}):\n"
        return _LOOP.format(step=repeat + "            mujoco.mj_step(model, data)\n")


class PythonLoopHold(SteppingPath):
    """`mj_step(model, data, nstep=hold)` in a loop: Python is entered once per control."""

    name = "python_loop_hold"
    summary = "for loop over mj_step(nstep=hold), one call per control"
    closed_loop = True
    options = (
        Option(
            "engine_threads",
            "the engine's own thread pool within one simulation (mju_threadpool)",
            (None,),
            int,
        ),
    )

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """See `SteppingPath.unsuited`."""
        if options.get("engine_threads") and not hasattr(mujoco, "mju_threadpool"):
            return "mju_threadpool exists from MuJoCo 3.10.0 on"
        return None

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        model, threads = workload.model, options.get("engine_threads")
        if threads:  # an MjData of its own: rollout refuses one that has a pool
            data = resources.get_or_create(
                ("engine_threads", threads), lambda: _pooled(model, threads)
            )
        else:
            (data,) = resources.datas(1)
        final_state = resources.final_state()
        spec, fresh = state_spec("INTEGRATION"), needs_reset(model)

        def run() -> None:
            simulate(
                model,
                data,
                workload.initial_state,
                workload.control,
                workload.hold,
                final_state,
                spec,
                fresh,
            )

        return Prepared(run, *fill_from_array(final_state))

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        code = _LOOP.format(step=f"        mujoco.mj_step(model, data, nstep={workload.hold})\n")
        threads = options.get("engine_threads")
        if threads:
            made = "data = mujoco.MjData(model)\n"
            code = code.replace(made, made + f"mujoco.mju_threadpool(data, {threads})\n")
        return code


def _pooled(model: mujoco.MjModel, threads: int) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mju_threadpool(data, threads)
    return data


_LOOP = """\
import mujoco
import numpy as np

full = mujoco.mjtState.mjSTATE_INTEGRATION
data = mujoco.MjData(model)
ctrl = data.ctrl
final_state = np.empty_like(initial_state)
for i in range(len(initial_state)):
    mujoco.mj_setState(model, data, initial_state[i], int(full))
    for u in control[i]:  # or u = policy(data)
        ctrl[:] = u
{step}    mujoco.mj_getState(model, data, final_state[i], int(full))
"""
