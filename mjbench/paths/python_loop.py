"""The plain Python loop: one `mj_step` call per step, or one per control."""

from typing import Any

import mujoco

from mjbench.paths import snippets
from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    SteppingPath,
    make_simulate,
    prepared_arrays,
)
from mjbench.simulation import compat
from mjbench.simulation.engine_clock import OFF_SNIPPET, TIMER_NAME, engine_clock, has_clock
from mjbench.simulation.workload import Product, Workload

_ON_OFF = ("on", "off")


class PythonLoop(SteppingPath):
    """`mj_step(model, data)` in a loop; every speed-up is relative to this path."""

    name = "python_loop"
    summary = "for loop over mj_step, one call per step"
    title = "the plain loop"
    closed_loop = True
    products = tuple(Product)
    options = (Option("clock", f"{TIMER_NAME} (mjData.timer)", ("on",), str, _ON_OFF),)

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        return {} if options["clock"] == "on" else options

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        if options.get("clock") == "off" and not has_clock(workload.model):
            return f"needs {TIMER_NAME}: 3.3.1 or newer installs it"
        return None

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        model, hold = workload.model, workload.hold
        (data,) = resources.datas(1)
        final_state, outputs = resources.final_state(), resources.step_outputs()
        spec, has_reset = compat.INTEGRATION, compat.has_sleep(model)
        record = make_simulate(model, hold, workload.returns)

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

        def run_recorded() -> None:
            record(data, workload.initial_state, workload.control, final_state, outputs)

        step_all = run if workload.returns == Product.FINAL else run_recorded

        def run_without_clock() -> None:
            with engine_clock(False):
                step_all()

        is_off = options.get("clock") == "off"
        return prepared_arrays(run_without_clock if is_off else step_all, final_state, outputs)

    def snippet(self, workload: Workload, options: Options) -> str:
        step = None
        if workload.hold > 1 and workload.returns == Product.FINAL:
            repeat = f"        for _ in range({workload.hold}):\n"
            step = repeat + "            mujoco.mj_step(model, data)\n"
        off = OFF_SNIPPET if options.get("clock") == "off" else ""
        return _after_creating_data(_loop(workload, step), off)


class PythonLoopHold(SteppingPath):
    """`mj_step(model, data, nstep=hold)` in a loop: one call from Python per control."""

    name = "python_loop_hold"
    summary = "for loop over mj_step(nstep=hold), one call per control"
    title = "mj_step with nstep"
    closed_loop = True
    products = tuple(Product)
    options = (
        Option(
            "engine_threads",
            "the engine's own thread pool within one simulation (mju_threadpool)",
            (None,),
            int,
        ),
    )

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        if workload.returns != Product.FINAL and workload.hold > 1:
            return (
                "returns no state between the steps of a control: --hold 1 or --returns final will"
                " do"
            )
        return compat.threadpool_unavailable() if options.get("engine_threads") else None

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        model, threads = workload.model, options.get("engine_threads")
        if threads:  # not one of the shared MjData: rollout refuses an MjData with a thread pool
            data = resources.get_or_create(
                ("engine_threads", threads), lambda: _data_with_threadpool(model, threads)
            )
        else:
            (data,) = resources.datas(1)
        final_state, outputs = resources.final_state(), resources.step_outputs()
        simulate = make_simulate(model, workload.hold, workload.returns)

        def run() -> None:
            simulate(data, workload.initial_state, workload.control, final_state, outputs)

        return prepared_arrays(run, final_state, outputs)

    def snippet(self, workload: Workload, options: Options) -> str:
        code = _loop(workload)
        threads = options.get("engine_threads")
        if threads:
            code = _after_creating_data(code, f"mujoco.mju_threadpool(data, {threads})")
        return code


def _after_creating_data(code: str, line: str) -> str:
    """Return a snippet with another line, unless that is empty, after MjData is created."""
    create = "data = mujoco.MjData(model)\n"
    return code.replace(create, f"{create}{line}\n") if line else code


def _data_with_threadpool(model: mujoco.MjModel, threads: int) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mju_threadpool(data, threads)
    return data


def _loop(workload: Workload, step: str | None = None) -> str:
    """Return the snippet of a loop, with these lines to take the steps of one control."""
    return _LOOP.format(
        allocate=snippets.allocation(workload),
        count=snippets.counter(workload, indent=4),
        step=step or snippets.data_steps(workload, indent=8, row="i"),
    )


_LOOP = """\
import mujoco
import numpy as np

full = int(mujoco.mjtState.mjSTATE_INTEGRATION)
data = mujoco.MjData(model)
ctrl = data.ctrl
final_state = np.empty_like(initial_state)
{allocate}for i in range(len(initial_state)):
    mujoco.mj_setState(model, data, initial_state[i], full)
{count}    for u in control[i]:  # or u = policy(data)
        ctrl[:] = u
{step}    mujoco.mj_getState(model, data, final_state[i], full)
"""
