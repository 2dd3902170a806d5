"""What decides where the code and the data of workers lie in memory, launch by launch.

Both targets of a launch get the same: identical code then finds its data and its libraries at
identical addresses, and only what differs between the targets makes a difference.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass

from mjbench.instrument import platforms

# Launches whose workers are forked from the same programs. What these share correlates launches:
# little where the kernel does not draw their addresses, too (see `benchmarks/shared_programs.py`).
_FIXED_LAUNCHES, _RANDOM_LAUNCHES = 8, 2


@dataclass(frozen=True)
class Addresses:
    """What the workers of one launch have in common.

    Attributes:
      seed: of all that a worker draws: the memory that it maps before MuJoCo's libraries and
        allocates before each layout, and how deep in the stack it runs.
      hash_seed: of the programs that they are forked from, for Python's hashes of text
        (PYTHONHASHSEED). They decide in which places of its dictionaries Python looks for names.
    """

    seed: int
    hash_seed: int


def launches_of_a_program() -> int:
    """Return for how many launches the programs that workers are forked from last."""
    return _FIXED_LAUNCHES if platforms.can_fix_addresses() else _RANDOM_LAUNCHES


def schedule(rng: random.Random, launches: int) -> Iterator[Addresses]:
    """Yield the addresses of one launch after the other, endlessly.

    Args:
      rng: draws them.
      launches: after how many the hash seed changes.
    """
    while True:
        hash_seed = rng.randrange(2**32)
        for _ in range(launches):
            yield Addresses(rng.randrange(2**32), hash_seed)
