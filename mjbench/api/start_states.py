"""From the start states that a program has to the plan by which a measurement draws starts."""

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from mjbench.api import checks
from mjbench.errors import InputError, describe, writing
from mjbench.instrument import scratch
from mjbench.simulation import starts
from mjbench.simulation.starts import StartPlan

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# A file of arrays by MjData field, or these arrays, as `mjbench.record` returns them.
States: TypeAlias = "str | os.PathLike[str] | Mapping[str, ArrayLike]"


@contextlib.contextmanager
def plan(settle_s: float | None, states: "States | None") -> Iterator[StartPlan]:
    """Yield where start states are to come from; arrays are in a file as long as the block lasts.

    Args:
      settle_s: simulated seconds for which a model moves before its first start; None for its
        default.
      states: start states of the program's own instead; None for none.

    Raises:
      InputError: both are given, or the states are not arrays, or there is no such file.
    """
    if settle_s is not None:
        settle_s = checks.seconds("settle_s", settle_s, zero=True)
    if states is None or isinstance(states, str | os.PathLike):
        yield starts.start_plan(settle_s, None if states is None else Path(states))
        return
    if not isinstance(states, Mapping):
        raise InputError(
            "states are a path, or arrays by MjData field as mjbench.record returns them, not an"
            f" object of type {type(states).__name__}"
        )
    with scratch.folder() as folder:
        file = folder / "states.npz"
        try:
            with writing(file):
                arrays: dict[str, Any] = {name: np.asarray(each) for name, each in states.items()}
                np.savez(file, **arrays)
        except TypeError as error:
            raise InputError(f"states cannot be stored as arrays: {describe(error)}") from error
        yield starts.start_plan(settle_s, file)
