"""From the start states and controls that a program has to the files that a measurement reads."""

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from mjbench.errors import InputError, describe, writing
from mjbench.host import files

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# A file of arrays by MjData field, or these arrays, as `mjbench.record` returns them.
States: TypeAlias = "str | os.PathLike[str] | Mapping[str, ArrayLike]"
# A file of controls, or an array of them: (ncontrol, nu) or (nsequence, ncontrol, nu).
Actions: TypeAlias = "str | os.PathLike[str] | ArrayLike"


@contextlib.contextmanager
def in_files(values: Mapping[str, Any]) -> Iterator[dict[str, Path]]:
    """Yield the files of `states` and `actions` among values; arrays lie in some for the block.

    Raises:
      InputError: they are not arrays.
    """
    stored: dict[str, Callable[[Any, Path], Path]]
    stored = {"states": _states_file, "actions": _actions_file}
    with files.temporary_folder() as folder:
        yield {
            name: file_of(values[name], folder)
            for name, file_of in stored.items()
            if values.get(name) is not None
        }


def _states_file(states: "States", folder: Path) -> Path:
    if isinstance(states, str | os.PathLike):
        return Path(states)
    if not isinstance(states, Mapping):
        raise InputError(
            "states are a path, or arrays by MjData field as mjbench.record returns them, not an"
            f" object of type {type(states).__name__}"
        )
    file = folder / "states.npz"
    with _refusing("states"):
        arrays: dict[str, Any] = {name: np.asarray(each) for name, each in states.items()}
        with writing(file):
            np.savez(file, **arrays)
    return file


def _actions_file(actions: "Actions", folder: Path) -> Path:
    if isinstance(actions, str | os.PathLike):
        return Path(actions)
    file = folder / "actions.npy"
    with _refusing("actions"):
        array = np.asarray(actions, dtype=float)
        with writing(file):
            np.save(file, array, allow_pickle=False)
    return file


@contextlib.contextmanager
def _refusing(name: str) -> Iterator[None]:
    try:
        yield
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} cannot be stored as arrays: {describe(error)}") from error
