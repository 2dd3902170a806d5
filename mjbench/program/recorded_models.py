"""Models that a program stepped, with a few states of each, as the call clock wrote them."""

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True, eq=False)
class RecordedModel:
    """A model of a program.

    Attributes:
      mjb: the model, as `mj_saveModel` writes it.
      states: (count, mj_stateSize) mjSTATE_INTEGRATION of states that the program was in.
      release: of MuJoCo that the program used; others cannot load the model.
    """

    mjb: bytes
    states: np.ndarray
    release: str


def read_all(folder: Path) -> Sequence[RecordedModel]:
    """Return the models in a folder; those of the first process that wrote any."""
    files = sorted(folder.glob("*.mjb"))
    of_first = [file for file in files if file.name.split(".")[0] == files[0].name.split(".")[0]]
    models = []
    for file in of_first:
        with contextlib.suppress(OSError, ValueError):
            engine = json.loads((folder / "engine.json").read_text(encoding="utf-8"))
            models.append(_read(file, engine["version"]))
    return models


def _read(file: Path, release: str) -> RecordedModel:
    values = np.fromfile(file.with_suffix(".states"))
    count = int(file.with_suffix(".count").read_text(encoding="utf-8"))
    return RecordedModel(file.read_bytes(), values.reshape(-1, count), release)
