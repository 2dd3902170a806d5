"""What both workers of a launch draw alike: where their memory lies, and Python's hashes.

Identical code then finds its data and its libraries at identical addresses on both sides, and only
what differs between the targets makes a difference.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass

from mjbench.host import platforms

# Launches whose workers are forked from the same programs. What these share correlates launches,
# but little where the kernel does not draw addresses.
FIXED_LAUNCHES, RANDOM_LAUNCHES = 8, 2


@dataclass(frozen=True)
class LaunchSeeds:
    """What the workers of one launch have in common.

    Attributes:
      memory: seed of what a worker draws: the memory that it maps before MuJoCo's libraries and
        allocates before each layout, and how deep in the stack it runs.
      program: seed of the programs that they are forked from, for Python's hashes of text
        (PYTHONHASHSEED) and where the stack begins. Hashes decide in which places of its
        dictionaries Python looks for names.
    """

    memory: int
    program: int


def launches_of_a_program() -> int:
    """Return for how many launches the programs that workers are forked from last."""
    if not platforms.can_adopt():
        return 1
    return FIXED_LAUNCHES if platforms.can_fix_addresses() else RANDOM_LAUNCHES


def schedule(rng: random.Random, launches: int) -> Iterator[LaunchSeeds]:
    """Yield the seeds of launches, endlessly; after `launches` of them, those of other programs."""
    while True:
        program = rng.randrange(2**32)
        for _ in range(launches):
            yield LaunchSeeds(rng.randrange(2**32), program)
