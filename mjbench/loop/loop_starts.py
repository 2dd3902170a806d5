"""From which states the loops of `profile` and `overhead` start: one, or many in turns.

These loops write no controls, because writing them is one of the habits that are measured. So each
run holds the controls of its start, and runs are short: a simulation stays where the program that
it was captured from was.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench.simulation import compat, sampling, work
from mjbench.simulation.models import ModelSource
from mjbench.simulation.sampling import SampleRequest
from mjbench.simulation.starts import StartPlan, Starts
from mjbench.simulation.work import Observation

# Start states that are drawn from a file.
NSTART = 256
# Steps of a run: at least so many, and as many as take about so long, in seconds. Restoring a
# state, which every run begins with, then counts for less than one percent.
LEAST_NSTEP, RUN_S = 5, 1e-4


@dataclass(frozen=True)
class LoopRequest:
    """What a child process of `profile` or `overhead` measures.

    Attributes:
      source: of the model.
      states_file: with start states of the user's own; None for keyframe 0.
      seed: of which of them are drawn.
    """

    source: ModelSource
    states_file: Path | None = None
    seed: int = 0


class StartsInTurn:
    """Restores one start state after the other, and the first after the last.

    Attributes:
      count: starts so far.
    """

    def __init__(self, model: mujoco.MjModel, states: np.ndarray, repeats: int = 1):
        """Prepare to start.

        Args:
          model: to step.
          states: (nstart, nstate) rows of mjSTATE_INTEGRATION, which include the controls.
          repeats: how often each is restored before the next.
        """
        self._rows, self._repeats = list(states), repeats
        self._spec, self._has_reset = compat.state_spec("INTEGRATION"), compat.has_sleep(model)
        self.count = 0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Restore the next start state."""
        row = self._rows[self.count // self._repeats % len(self._rows)]
        self.count += 1
        if self._has_reset:
            mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, row, self._spec)


class LoopStarts:
    """The start states of a file, for loops that hold the controls of their start.

    Attributes:
      starts: where they came from.
      observation: what the steps of all runs did.
      nstep: steps of a run.
    """

    def __init__(self, model: mujoco.MjModel, file: Path, nstep: int | None = None, seed: int = 0):
        """Draw starts.

        Args:
          model: to step.
          file: with the states (see `state_file`).
          nstep: steps of a run; None for as many as take about RUN_S.
          seed: of which states are drawn.

        Raises:
          InputError: the file does not fit the model, or every simulation diverges.
        """
        self._model = model
        self.nstep = nstep or max(LEAST_NSTEP, int(RUN_S / work.step_s(model)))
        request = SampleRequest(NSTART, self.nstep, self.nstep, seed, StartPlan(file=file))
        sample = sampling.draw(model, request)
        self.starts: Starts = sample.starts
        self.observation: Observation = sample.observation
        self._states = sample.workload.initial_state
        columns = compat.state_columns(model, compat.state_spec("INTEGRATION"))
        if "ctrl" in columns:
            self._states[:, columns["ctrl"]] = sample.workload.control[:, 0]

    def in_turn(self, repeats: int = 1) -> StartsInTurn:
        """Return what restores the states, from the first on, each `repeats` times in a row."""
        return StartsInTurn(self._model, self._states, repeats)
