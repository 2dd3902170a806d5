"""From the start states that a program has to the plan by which a measurement draws starts."""

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from mjbench.api import argument_values
from mjbench.errors import InputError, describe, writing
from mjbench.host import files
from mjbench.limits import SECONDS_OR_ZERO
from mjbench.simulation import starts
from mjbench.simulation.starts import StartPlan

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# A file of arrays by MjData field, or these arrays, as `mjbench.record` returns them.
States: TypeAlias = "str | os.PathLike[str] | Mapping[str, ArrayLike]"
# A file of controls, or an array of them: (ncontrol, nu) or (nsequence, ncontrol, nu).
Actions: TypeAlias = "str | os.PathLike[str] | ArrayLike"


@contextlib.contextmanager
def plan(
    settle_s: float | None, states: "States | None", actions: "Actions | None" = None
) -> Iterator[StartPlan]:
    """Yield where start states and controls come from; arrays are in files while the block lasts.

    Raises:
      InputError: both `settle_s` and `states` are given, they are not arrays, or there is no such
        file.
    """
    settle_s = argument_values.optional(
        argument_values.number, "settle_s", settle_s, SECONDS_OR_ZERO
    )
    with files.temporary_folder() as folder:
        yield starts.start_plan(
            settle_s,
            None if states is None else _states_file(states, folder),
            None if actions is None else _actions_file(actions, folder),
        )


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
