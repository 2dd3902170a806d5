"""NumPy on single numbers, on indices, and on arrays."""

import numpy as np

NUMBERS = [np.float64(0.1 * i) for i in range(50)]
ARRAY = np.linspace(0.0, 3.0, 20_000)
SHAPE = (50, 60, 9)
# A fifth of the values are unique, in random order.
REPEATED = np.random.default_rng(0).integers(0, 40_000, 200_000) * (1 + 1j)


def scalars() -> np.float64:
    """Call a function of one argument on single numbers."""
    for number in NUMBERS:
        sine = np.sin(number)
    return sine


def array() -> np.ndarray:
    """Call the same function on an array."""
    return np.sin(ARRAY)


def indices() -> tuple[int, ...]:
    """Visit the indices of an array."""
    for index in np.ndindex(SHAPE):
        last = index
    return last


def unique_complex() -> np.ndarray:
    """Find the unique values of a complex array."""
    return np.sort(np.unique(REPEATED))


def sort_complex() -> np.ndarray:
    """Sort a complex array."""
    return np.sort(REPEATED)
