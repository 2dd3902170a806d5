"""The plain loop in sections, which blocks time one after the other.

What else the machine does changes within a millisecond how fast a core is. So the two targets
take turns after a tenth of that: a block is one section of the run. The section before it runs
first, untimed, because the caches still hold what the other target did.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjbench.errors import MachineError
from mjbench.measuring import calls
from mjbench.paths import Resources
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload


@dataclass(frozen=True)
class LoopSection:
    """A part of a run, or a whole one.

    Attributes:
      run: does this part, from where `warm_up` ended.
      warm_up: does the part before it, from a state that it restores.
      check: raises MachineError if `run` did not end in the state that the whole run has there.
      reading: what a block gives, after `run`; None for its nanoseconds.
    """

    run: Callable[[], None]
    warm_up: Callable[[], None] = calls.nothing
    check: Callable[[], None] = calls.nothing
    reading: Callable[[], int] | None = None


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Consecutive steps of one simulation.

    Attributes:
      start: (nstate,) to begin at; None to go on from where the stretch before ended.
      controls: (n, nu) one for each `hold` steps.
      end: (nstate,) that the state after them is written to; None where it is not needed.
    """

    start: np.ndarray | None
    controls: np.ndarray
    end: np.ndarray | None


def can_divide(workload: Workload, count: int) -> bool:
    """Return whether a run can be divided: sections end in the states that it has there."""
    count = min(count, workload.nbatch * workload.ncontrol)
    if count < 2 or compat.has_sleep(workload.model):
        return False
    resources = Resources(workload)
    try:
        for section in sections(resources, count):
            section.warm_up()
            section.run()
            section.check()
    except MachineError:
        return False
    finally:
        resources.close()
    return True


def sections(resources: Resources, count: int) -> list[LoopSection]:
    """Return the sections of a run of the path `python_loop`, in their order.

    It does the run once, and leaves its final states in `final_state()`.

    Args:
      resources: of the workload, whose model must not need a reset between simulations. Their first
        MjData is stepped, and `final_state()` is written, by this function and by the sections.
    """
    workload = resources.workload
    ncontrol = workload.nbatch * workload.ncontrol
    bounds = [round(k * ncontrol / count) for k in range(count + 1)]
    stretches = [list(_stretches(resources, *bounds[k : k + 2])) for k in range(count)]
    runs = [_run(resources, each) for each in stretches]
    ends = []
    for run in runs:
        run()
        ends.append(_state(resources))

    def warm_up(k: int) -> Callable[[], None]:
        """Return what does the section before the k-th; before the first one, the last."""
        first, *others = stretches[k - 1]
        start = ends[k - 2] if first.start is None else first.start
        return _run(resources, [replace(first, start=start), *others])

    return [LoopSection(runs[k], warm_up(k), _check(resources, ends[k])) for k in range(count)]


def after_lead_in(resources: Resources) -> LoopSection:
    """Return the whole run of the path `python_loop` as one section, which follows its lead-in.

    The lead-in is stepped once, here. Copies of the MjData that it ends in hold what sleeps.
    """
    workload, final_state = resources.workload, resources.final_state()
    model, hold, spec = workload.model, workload.hold, compat.INTEGRATION
    led_in = [mujoco.MjData(model) for _ in range(workload.nbatch)]
    datas = list(resources.datas(workload.nbatch))
    first = workload.lead_in // hold
    for data, start, controls in zip(led_in, workload.initial_state, workload.control, strict=True):
        compat.restart(model, data, start)
        for values in controls[:first]:
            data.ctrl[:] = values
            mujoco.mj_step(model, data, hold)

    def warm_up() -> None:
        datas[:] = map(compat.copied_data, [model] * len(datas), datas, led_in)

    def run() -> None:
        mj_step = mujoco.mj_step
        for data, controls, end in zip(
            datas, workload.control[:, first:], final_state, strict=True
        ):
            ctrl = data.ctrl
            for values in controls:
                ctrl[:] = values
                for _ in range(hold):
                    mj_step(model, data)
            mujoco.mj_getState(model, data, end, spec)

    section = LoopSection(run, warm_up)
    section.warm_up()
    section.run()
    return section


def _check(resources: Resources, end: np.ndarray) -> Callable[[], None]:
    def check() -> None:
        if not np.array_equal(_state(resources), end, equal_nan=True):
            raise MachineError("steps from a restored state do not end where the run does")

    return check


def _state(resources: Resources) -> np.ndarray:
    workload, (data,) = resources.workload, resources.datas(1)
    state = np.empty(workload.initial_state.shape[1])
    compat.get_state(workload.model, data, state)
    return state


def _stretches(resources: Resources, begin: int, end: int) -> Iterator[_Stretch]:
    """Yield the stretches of some controls, counted through all simulations."""
    workload, final_state = resources.workload, resources.final_state()
    while begin < end:
        i, first = divmod(begin, workload.ncontrol)
        last = min(workload.ncontrol, first + end - begin)
        yield _Stretch(
            workload.initial_state[i] if first == 0 else None,
            workload.control[i, first:last],
            final_state[i] if last == workload.ncontrol else None,
        )
        begin += last - first


def _run(resources: Resources, stretches: Sequence[_Stretch]) -> Callable[[], None]:
    """Return a function that steps stretches as the path `python_loop` does."""
    workload, (data,) = resources.workload, resources.datas(1)
    model, hold, spec = workload.model, workload.hold, compat.INTEGRATION

    def run() -> None:
        mj_step, ctrl = mujoco.mj_step, data.ctrl
        for stretch in stretches:
            if stretch.start is not None:
                mujoco.mj_setState(model, data, stretch.start, spec)
            for values in stretch.controls:
                ctrl[:] = values
                for _ in range(hold):
                    mj_step(model, data)
            if stretch.end is not None:
                mujoco.mj_getState(model, data, stretch.end, spec)

    return run
