"""The plain loop, each step timed on its own: how long do its slowest steps take?

A block gives the time that 99 of 100 of its steps do not exceed. Blocks of both targets are of the
same states, and a verdict rests on the median of many, so it compares the steps that are heavy, as
in contact, and not those that the machine interrupted. Each time includes one reading of
the clock.
"""

import math
import time

import mujoco
import numpy as np

from mjbench.paths.base import needs_reset
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

_SHARE = 0.99


class TimedSteps:
    """A workload whose steps are timed one by one.

    Attributes:
      final_state: (nbatch, nstate) where each simulation ended in the last run.
    """

    def __init__(self, workload: Workload):
        """Allocate what a run needs."""
        self.final_state = np.empty_like(workload.initial_state)
        self._workload = workload
        self._data = mujoco.MjData(workload.model)
        self._spec = compat.state_spec("INTEGRATION")
        self._has_reset = needs_reset(workload.model)
        self._ns = np.empty(workload.nbatch * workload.nstep, dtype=np.int64)

    def run(self) -> None:
        """Take all steps."""
        workload, data, ns, hold = self._workload, self._data, self._ns, self._workload.hold
        model, mj_step, clock = workload.model, mujoco.mj_step, time.perf_counter_ns
        k = 0
        for start, controls, end in zip(
            workload.initial_state, workload.control, self.final_state, strict=True
        ):
            if self._has_reset:
                mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start, self._spec)
            for values in controls:
                data.ctrl[:] = values
                for _ in range(hold):
                    begin = clock()
                    mj_step(model, data)
                    ns[k] = clock() - begin
                    k += 1
            compat.get_state(model, data, end, self._spec)

    def p99_ns(self) -> int:
        """Return the nanoseconds that 99 of 100 steps of the last run do not exceed.

        It is an order statistic of the steps, not an interpolation.
        """
        rank = math.ceil(_SHARE * len(self._ns)) - 1
        return int(np.partition(self._ns, rank)[rank])
