"""What environments return: copied, and compared to the last bit."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mjbench.errors import InputError


def copied(observation: Any) -> Any:
    """Return a copy of an observation or another value, as environments may use its memory again.

    Raises:
      InputError: it holds something else than arrays, numbers, mappings and tuples.
    """
    match observation:
        case Mapping():
            return {key: copied(value) for key, value in observation.items()}
        case tuple() | list():
            return tuple(copied(value) for value in observation)
        case np.ndarray() | np.generic() | float() | int():
            return np.array(observation)
    raise InputError(f"it returns {type(observation).__name__}, which cannot be compared")


def equal(single: Any, batched: Any, i: int) -> bool:
    """Return whether entry `i` of batched observations is that of one environment, bit by bit.

    A vectorised form converts observations to the types of the observation space.
    """
    if isinstance(single, dict):
        return all(equal(value, batched[key], i) for key, value in single.items())
    if isinstance(single, tuple):
        return all(equal(value, part, i) for value, part in zip(single, batched, strict=True))
    got = np.asarray(batched[i])
    expected = np.asarray(single).astype(got.dtype).reshape(got.shape)
    return bool(expected.tobytes() == got.tobytes())
