"""Controls of the user's own: a file with one sequence of controls, or with several.

The array is called `ctrl` or `actions`, or is the only one of an .npy file. Its shape is (ncontrol,
nu), a sequence that every simulation takes, or (nsequence, ncontrol, nu). Each row is one control
in the actuators' units, held for `hold` steps. Simulations begin with the first row.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench.errors import InputError, shown
from mjbench.simulation import array_files, capture_header

# Names of the array; where a file has both, the first.
_NAMES = ("ctrl", "actions")


@dataclass(frozen=True, eq=False)
class GivenControls:
    """The controls of a file."""

    sequences: np.ndarray
    name: str

    def most_nstep(self, hold: int) -> int:
        return int(self.sequences.shape[1]) * hold

    def check(self, nstep: int, hold: int) -> None:
        most = self.most_nstep(hold)
        if nstep > most:
            count = self.sequences.shape[1]
            held = f", each held for {hold} steps," if hold > 1 else ""
            raise InputError(
                f"{self.name} has {count} controls{held} and not for {nstep} steps: give --nstep"
                f" {most} at most"
            )

    def of_simulations(self, nbatch: int, ncontrol: int) -> np.ndarray:
        """Return (nbatch, ncontrol, nu): simulation i takes sequence i, from the first on again."""
        numbers = np.arange(nbatch) % len(self.sequences)
        return np.ascontiguousarray(self.sequences[numbers, :ncontrol])

    def of_states(self, rows: np.ndarray, nrow: int, ncontrol: int) -> np.ndarray:
        """Return (nbatch, ncontrol, nu) controls of simulations that start from rows of a file.

        Where there is a sequence for each of the file's `nrow` states, a simulation takes that of
        its state; otherwise as `of_simulations`.
        """
        if len(self.sequences) == nrow:
            return np.ascontiguousarray(self.sequences[rows, :ncontrol])
        return self.of_simulations(len(rows), ncontrol)


def read(file: Path, model: mujoco.MjModel) -> GivenControls:
    name = shown(file.name)
    values = array_files.floats(_read_array(file, name), name)
    if values.ndim not in (2, 3):
        raise InputError(
            f"{name} has controls of shape {values.shape}; expected (ncontrol, nu), or"
            " (nsequence, ncontrol, nu)"
        )
    if values.shape[-1] != model.nu or model.nu == 0:
        raise InputError(
            f"{name}: the model has {model.nu} controls, the file's have {values.shape[-1]} numbers"
        )
    if values.size == 0:
        raise InputError(f"{name} holds no controls")
    return GivenControls(values.reshape(-1, *values.shape[-2:]), name)


def _read_array(file: Path, name: str) -> np.ndarray:
    content = array_files.read(file, "controls", _NAMES)
    named = (content.arrays[name] for name in _NAMES if name in content.arrays)
    array = content.unnamed if content.unnamed is not None else next(named, None)
    if array is None:
        raise InputError(f"{name} has neither ctrl nor actions; it has {content.listing}")
    if capture_header.ARRAY in content.names:
        raise InputError(
            f"{name} holds captured states: give it to --states, which replays its controls"
        )
    return array
