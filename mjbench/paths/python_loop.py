"""The plain Python loop: one `mj_step` call per step, or one per control."""

import mujoco

from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    SteppingPath,
    array_callbacks,
    make_simulate,
    needs_reset,
)
from mjbench.simulation import compat
from mjbench.simulation.compat import state_spec
from mjbench.simulation.workload import Workload


class PythonLoop(SteppingPath):
    """`mj_step(model, data)` in a loop; every speed-up is relative to this path."""

    name = "python_loop"
    summary = "for loop over mj_step, one call per step"
    closed_loop = True

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        model, hold = workload.model, workload.hold
        (data,) = resources.datas(1)
        final_state = resources.final_state()
        spec, has_reset = state_spec("INTEGRATION"), needs_reset(model)

        def run() -> None:
            mj_step, ctrl = mujoco.mj_step, data.ctrl
            for start, controls, end in zip(
                workload.initial_state, workload.control, final_state, strict=True
            ):
                if has_reset:
                    mujoco.mj_resetData(model, data)
                mujoco.mj_setState(model, data, start, spec)
                for values in controls:
                    ctrl[:] = values
                    for _ in range(hold):
                        mj_step(model, data)
                mujoco.mj_getState(model, data, end, spec)

        return Prepared(run, *array_callbacks(final_state))

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        if workload.hold == 1:
            return _LOOP.format(step="        mujoco.mj_step(model, data)\n")
        repeat = f"        for _ in range({workload.hold}):\n"
        return _LOOP.format(step=repeat + "            mujoco.mj_step(model, data)\n")


class PythonLoopHold(SteppingPath):
    """`mj_step(model, data, nstep=hold)` in a loop: one call from Python per control."""

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
        return compat.threadpool_unavailable() if options.get("engine_threads") else None

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        model, threads = workload.model, options.get("engine_threads")
        if threads:  # not one of the shared MjData: rollout refuses an MjData with a thread pool
            data = resources.get_or_create(
                ("engine_threads", threads), lambda: _data_with_threadpool(model, threads)
            )
        else:
            (data,) = resources.datas(1)
        final_state = resources.final_state()
        simulate = make_simulate(model, workload.hold)

        def run() -> None:
            simulate(data, workload.initial_state, workload.control, final_state)

        return Prepared(run, *array_callbacks(final_state))

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        code = _LOOP.format(step=f"        mujoco.mj_step(model, data, nstep={workload.hold})\n")
        threads = options.get("engine_threads")
        if threads:
            create = "data = mujoco.MjData(model)\n"
            code = code.replace(create, create + f"mujoco.mju_threadpool(data, {threads})\n")
        return code


def _data_with_threadpool(model: mujoco.MjModel, threads: int) -> mujoco.MjData:
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
