"""The plain loop in sections, which blocks time one by one.

What else the machine does changes within a millisecond how fast a core is. So the two targets
take turns after a tenth of that: a block is one section of the simulations' steps. The section
before it runs first, untimed, because the caches still hold what the other target did.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjbench.errors import MachineError
from mjbench.paths import Resources
from mjbench.paths.base import needs_reset
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload


@dataclass(frozen=True)
class Section:
    """A part of what a run of the plain loop does.

    Attributes:
      warm_up: does what comes before it, from a state that it restores.
      run: does it, from where `warm_up` ended.
    """

    warm_up: Callable[[], None]
    run: Callable[[], None]


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


def can_divide(workload: Workload) -> bool:
    """Return whether steps from a restored state of a run end where the run does."""
    if needs_reset(workload.model) or workload.ncontrol < 2:
        return False
    first = workload.only(np.arange(workload.nbatch) == 0)
    resources = Resources(first)
    try:
        section(resources, 1, 2)
    except MachineError:
        return False
    finally:
        resources.close()
    return True


def section(resources: Resources, index: int, count: int) -> Section:
    """Return a section of a run of the path `python_loop`.

    Args:
      resources: of the workload, whose model must not need a reset between simulations. Their first
        MjData is stepped, and `final_state()` is written, by this function and by the section.
      index: of the section, from 0; the last one warms up the first.
      count: of sections, two or more, each of as many controls as the others, or of one more.

    Raises:
      MachineError: the section ends in another state than the run does there.
    """
    workload = resources.workload
    ncontrol = workload.nbatch * workload.ncontrol
    ends = [round(k * ncontrol / count) for k in range(count + 1)]
    stretches = [list(_stretches(resources, *ends[k : k + 2])) for k in range(count)]
    runs = [_run(resources, each) for each in stretches]
    ends_in = []
    for run in runs:
        run()
        ends_in.append(_state(resources))
    first, *others = stretches[index - 1]
    start = ends_in[index - 2] if first.start is None else first.start
    warm_up = _run(resources, [replace(first, start=start), *others])
    warm_up()
    runs[index]()
    if not np.array_equal(_state(resources), ends_in[index], equal_nan=True):
        raise MachineError("steps from a restored state do not end where the run does")
    return Section(warm_up, runs[index])


def _state(resources: Resources) -> np.ndarray:
    workload, (data,) = resources.workload, resources.datas(1)
    state = np.empty(workload.initial_state.shape[1])
    compat.get_state(workload.model, data, state, compat.state_spec("INTEGRATION"))
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
    model, hold = workload.model, workload.hold
    spec = compat.state_spec("INTEGRATION")

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
