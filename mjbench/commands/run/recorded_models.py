"""Models that a program stepped, with a few states of each, as the call clock wrote them."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjbench.commands.run.step_times import read_engine

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class RecordedModel:
    """A model of a program.

    Attributes:
      states: (count, mj_stateSize) mjSTATE_INTEGRATION of states that the program was in.
      copied: likewise, of those that it copied; none where it copies none.
      release: of MuJoCo that the program used; others cannot load the model.
    """

    mjb: bytes
    states: np.ndarray
    copied: np.ndarray
    release: str

    def load(self) -> "mujoco.MjModel":
        """Return the model; only MuJoCo of the same release can load it."""
        import mujoco

        name = "model.mjb"
        return mujoco.MjModel.from_binary_path(name, {name: self.mjb})


def read_all(folder: Path) -> Sequence[RecordedModel]:
    """Return the models in a folder; those of the first process that wrote any."""
    files = sorted(folder.glob("*.mjb"))
    of_first = [file for file in files if file.name.split(".")[0] == files[0].name.split(".")[0]]
    models = []
    for file in of_first:
        with contextlib.suppress(OSError, ValueError):
            models.append(_read(file, read_engine(folder).version))
    return models


def loadable(models: Sequence[RecordedModel]) -> RecordedModel | None:
    """Return the first model with states that this process's MuJoCo can load; None without one."""
    import mujoco

    usable = (each for each in models if each.release == mujoco.__version__ and len(each.states))
    return next(usable, None)


def _read(file: Path, release: str) -> RecordedModel:
    size = int(file.with_suffix(".count").read_text(encoding="utf-8"))
    return RecordedModel(
        file.read_bytes(),
        _states(file.with_suffix(".states"), size),
        _states(file.with_suffix(".copied"), size),
        release,
    )


def _states(file: Path, size: int) -> np.ndarray:
    return np.fromfile(file).reshape(-1, size) if file.is_file() else np.empty((0, size))
