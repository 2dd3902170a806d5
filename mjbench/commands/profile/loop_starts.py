"""From which states the loops of `profile` and `profile --habits` start: many, in turns.

They are those of every other command. These loops write no controls, because writing them is one of
the habits that are measured. So each run holds the controls of its start, and runs are short: a
simulation stays where it started.
"""

import mujoco
import numpy as np

from mjbench.simulation import compat, reference_run, starts, workload_sampling
from mjbench.simulation.reference_run import Observation
from mjbench.simulation.starts import StartPlan, Starts
from mjbench.simulation.workload_sampling import SampleRequest

# Start states that are drawn; fewer where to step from all of them would take more seconds than
# this, but not fewer than the least.
NSTART, LEAST_NSTART, DRAWING_S = 256, 16, 1.0
# Steps of a run: at least so many, and as many as take about so long, in seconds. Restoring a
# state, which every run begins with, then counts for less than one percent.
LEAST_NSTEP, RUN_S = 5, 1e-4


class StartsInTurn:
    """Restores one start state after the other, the first after the last, and counts them."""

    def __init__(self, model: mujoco.MjModel, states: np.ndarray, repeats: int = 1):
        """Restore (nstart, nstate) states with their controls, each `repeats` times in a row."""
        self._rows, self._repeats = list(states), repeats
        self._has_reset = compat.has_sleep(model)
        self.count = 0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        row = self._rows[self.count // self._repeats % len(self._rows)]
        self.count += 1
        if self._has_reset:
            mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, row, compat.INTEGRATION)


class LoopStarts:
    """Start states for loops that hold the controls of their start for `nstep` steps of a run."""

    def __init__(
        self, model: mujoco.MjModel, plan: StartPlan, nstep: int | None = None, seed: int = 0
    ):
        """Draw starts for runs of `nstep` steps; None for as many as take about RUN_S."""
        self._model, step_s = model, reference_run.step_s(model)
        self.nstep = nstep or max(LEAST_NSTEP, int(RUN_S / step_s))
        affordable = int(DRAWING_S / (self.nstep * step_s))
        nstart = min(NSTART, max(LEAST_NSTART, affordable))
        max_nstep = starts.max_settling_nstep(step_s)
        request = SampleRequest(nstart, self.nstep, self.nstep, seed, plan, max_nstep)
        sample = workload_sampling.draw(model, request)
        self.starts: Starts = sample.starts
        self.observation: Observation = sample.observation
        self.states = sample.workload.initial_state
        columns = compat.state_columns(model)
        if "ctrl" in columns:
            self.states[:, columns["ctrl"]] = sample.workload.control[:, 0]

    def in_turn(self, repeats: int = 1) -> StartsInTurn:
        """Return what restores the states, from the first on, each `repeats` times in a row."""
        return StartsInTurn(self._model, self.states, repeats)
