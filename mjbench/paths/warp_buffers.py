"""MuJoCo Warp's buffers of a fixed size: how large to make them, and how to read them.

Both ways of calling MuJoCo Warp need this: by itself (`warp.py`) and from JAX (`mjx.py`).
"""

import numpy as np
from numpy.typing import ArrayLike

from mjbench.errors import MachineError
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_run import Peaks

# Buffers hold this many times the contacts and constraints that C needs at most.
_PEAK_FACTOR = 2
# The contact buffer also holds pairs that are merely near. Its size is at least MuJoCo Warp's own
# default for each world of a model of plain geoms (make_data without nconmax).
_MIN_CONTACTS = 48
# Overflow flags of MuJoCo Warp that concern iterations, not the size of a buffer.
_ITERATION_FLAGS = ("ITERATIONS", "LS_ITERATIONS")


class OverflowedError(MachineError):
    """One of MuJoCo Warp's buffers was too small."""


def buffer_sizes(peaks: Peaks, nbatch: int) -> dict[str, int]:
    """Return buffer sizes by make_data's names: contacts of all worlds, constraints of each."""
    return {
        "naconmax": nbatch * max(_MIN_CONTACTS, _PEAK_FACTOR * peaks.contacts),
        "njmax": max(1, _PEAK_FACTOR * peaks.constraints),
    }


def read_contacts(
    count: ArrayLike,
    world: ArrayLike,
    geom: ArrayLike,
    distance: ArrayLike,
    position: ArrayLike,
    frame: ArrayLike,
    margin: ArrayLike,
) -> Contacts:
    """Return the contacts in Warp's buffers that are near enough to count.

    Args:
      count: number of rows in use, an array of one.
      world: (n,) simulations.
      geom: (n, 2) ids.
      distance: (n,) between the geoms, in m.
      position: (n, 3), in m.
      frame: (n, 3, 3) axes, the normal first.
      margin: (n,) distance below which a contact counts, in m.
    """
    distances = np.asarray(distance)
    used = slice(min(int(np.ravel(count)[0]), len(distances)))
    near = distances[used] < np.asarray(margin)[used]
    arrays = (world, geom, distance, position, frame)
    return Contacts.of(*(np.asarray(array)[used][near] for array in arrays))


def check_overflow(flags: np.ndarray) -> None:
    """Reject overflow flags of MuJoCo Warp's worlds by an OverflowedError that names the buffer."""
    from mujoco_warp import OverflowType

    single = [flag for flag in OverflowType if flag.value and not flag.value & (flag.value - 1)]
    overflowed = [f for f in single if f.name not in _ITERATION_FLAGS and (flags & f.value).any()]
    if overflowed:
        worlds = int(np.count_nonzero(flags & sum(f.value for f in overflowed)))
        names = ", ".join(str(f.name) for f in overflowed)
        raise OverflowedError(f"buffers of Warp overflowed in {worlds} worlds: {names}")
