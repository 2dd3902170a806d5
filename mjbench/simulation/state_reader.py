"""States of a simulation as rows of numbers, and the fields in which two of them differ."""

import mujoco
import numpy as np

from mjbench.simulation import compat


class StateReader:
    """Reads states of simulations of one model, and compares them."""

    def __init__(self, model: mujoco.MjModel):
        self.spec = compat.INTEGRATION
        self.columns = compat.state_columns(model)
        self.nstate = compat.state_size(model)
        ctrl = self.columns.get("ctrl", slice(self.nstate, self.nstate))
        self._before_ctrl, self._after_ctrl = slice(ctrl.start), slice(ctrl.stop, None)

    def read(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Return (nstate,) the state of a simulation now."""
        state = np.empty(self.nstate)
        compat.get_state(model, data, state)
        return state

    def differing(self, state: np.ndarray, other: np.ndarray) -> set[str]:
        """Return the MjData fields, other than the controls, that differ in any bit."""
        before, after = self._before_ctrl, self._after_ctrl
        if (
            state[before].tobytes() == other[before].tobytes()
            and state[after].tobytes() == other[after].tobytes()
        ):
            return set()
        return {
            field
            for field, place in self.columns.items()
            if field != "ctrl" and state[place].tobytes() != other[place].tobytes()
        }
