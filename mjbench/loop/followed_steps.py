"""Follow the steps of one MjData, and store its states as segments of consecutive steps.

A *segment* is a state and those after each further step. A replay from one of these states, with
the controls of those that follow, repeats the program to the last bit, as long as the program sets
only controls between its steps. If it changes the state itself, as by a reset, a new segment
begins. If it sets another input, such as a force, the segment goes on, and `changed_inputs` names
the input.
"""

import weakref

import mujoco
import numpy as np

from mjbench.loop.engine_functions import EngineFunction
from mjbench.simulation.state_reader import StateReader

# Fields of mjSTATE_INTEGRATION that steps change: a program that sets one begins a new segment.
_MOVED = frozenset(("time", "qpos", "qvel", "act", "history", "plugin_state", "plastic"))
# If a step takes another time than the timestep, by more than this share, the engine was reset.
_TIME_SHARE = 0.5


class FollowedSteps:
    """The states of one MjData over some of its steps.

    Attributes:
      changed_inputs: MjData fields, other than the controls, that were set between steps.
    """

    def __init__(
        self,
        reader: StateReader,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        most_states: int,
    ):
        """Follow an MjData.

        Args:
          reader: of its states.
          model: that it is of.
          data: to follow.
          most_states: the most to store.
        """
        self._reader = reader
        self._get_state = mujoco.mj_getState
        self._timestep = float(model.opt.timestep)
        self._data = weakref.ref(data)  # the program decides how long it lives
        self.changed_inputs: set[str] = set()
        self._states = np.empty((most_states, reader.nstate))
        self._count = 0
        self._begins: list[int] = []  # of segments, as rows of the states
        self._before = np.empty(reader.nstate)
        self._last: np.ndarray | None = None

    @property
    def data(self) -> mujoco.MjData | None:
        """The one that is followed; None where the program has dropped it."""
        return self._data()

    def follows(self, data: mujoco.MjData) -> bool:
        """Return whether this is the one that is followed, and there is room for another state."""
        return self._data() is data and self._count < len(self._states)

    def step(
        self,
        function: EngineFunction,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        nstep: int,
    ) -> int:
        """Take steps one by one, and store the states after them.

        Args:
          function: takes a step.
          model: that is stepped.
          data: the one that is followed.
          nstep: steps to take; fewer are taken where there is no room for more states.

        Returns:
          How many were taken, at least 1.
        """
        before, last, spec = self._before, self._last, self._reader.spec
        self._get_state(model, data, before, spec)
        if last is None or self._is_elsewhere(before, last):
            self._begin_segment(before)
        self._last = None  # and stays so where a step raises
        for taken in range(1, nstep + 1):
            begin_s = data.time
            function(model, data)
            if abs(data.time - begin_s - self._timestep) > _TIME_SHARE * self._timestep:
                return taken  # the engine started the simulation anew, from a bad state
            if self._count == len(self._states):
                return taken
            after = self._states[self._count]
            self._get_state(model, data, after, spec)
            self._count += 1
        self._last = after
        return nstep

    def _is_elsewhere(self, before: np.ndarray, last: np.ndarray) -> bool:
        """Return whether the program has changed the state since the last step; note inputs."""
        changed = self._reader.differing(before, last)
        if changed & _MOVED:
            return True
        self.changed_inputs |= changed
        return False

    def _begin_segment(self, before: np.ndarray) -> None:
        self._begins.append(self._count)
        self._states[self._count] = before
        self._count += 1

    def segments(self) -> list[np.ndarray]:
        """Return (count, nstate) states of each segment that has a step.

        A segment ends before a state that is not finite; the engine may be set to continue from it.
        """
        ends = [*self._begins[1:], self._count]
        pairs = zip(self._begins, ends, strict=True)
        finite = [_until_not_finite(self._states[begin:end]) for begin, end in pairs]
        return [segment for segment in finite if len(segment) > 1]


def _until_not_finite(states: np.ndarray) -> np.ndarray:
    is_bad = ~np.isfinite(states).all(axis=1)
    return states[: int(is_bad.argmax())] if is_bad.any() else states
