"""Where the memory of a worker lies: elsewhere in each launch, and alike for both of its sides.

Identical code then finds its data and its libraries at identical addresses on both sides, and only
what differs between the targets makes a difference. This module is imported inside any
release, before MuJoCo and NumPy are.
"""

import mmap
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mjbench.host import platforms

# Random allocations before each layout: how many, and the largest of each kind, in bytes.
_SMALL, _SMALL_BYTES = 400, 4096
_LARGE, _LARGE_BYTES = 8, 1 << 21
# Memory mapped before MuJoCo's libraries are: fewer pieces, each of fewer pages, than these. Linux
# maps large libraries at multiples of 2 MiB; so the pieces are large, and nothing uses them.
_MAPS, _MAP_PAGES = 8, 1 << 14

# Launches whose workers are forked from the same programs. What these share correlates launches,
# but little where the kernel does not draw addresses.
FIXED_LAUNCHES, RANDOM_LAUNCHES = 8, 2


def mapped(rng: random.Random) -> list[mmap.mmap]:
    """Map a random number of pages, which move whatever is mapped after them."""
    return [_map_pages(rng) for _ in range(rng.randrange(1, _MAPS))]


def _map_pages(rng: random.Random) -> mmap.mmap:
    size = mmap.PAGESIZE * rng.randrange(1, _MAP_PAGES)
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    return mmap.mmap(-1, size, flags=flags, prot=mmap.PROT_READ)  # takes up no memory


def scattered(rng: random.Random) -> list[object]:
    """Return blocks of memory that move whatever is allocated after them to random places."""
    import numpy as np

    small = [bytearray(rng.randrange(16, _SMALL_BYTES)) for _ in range(_SMALL)]
    # of NumPy, which writes nothing to them: that would take 5 ms
    large = [np.empty(rng.randrange(1 << 12, _LARGE_BYTES), np.uint8) for _ in range(_LARGE)]
    # half of them are freed at once: holes that the allocator fills with some of what comes next
    return [*rng.sample(small, _SMALL // 2), *rng.sample(large, _LARGE // 2)]


def call_deeper(levels: int, function: Callable[[], None]) -> None:
    """Call `function` below `levels` further frames of the C stack."""
    if levels == 0:
        function()
    else:
        # Since Python 3.11 a call from Python to Python adds no frame to the C stack. `map` is
        # written in C and calls back into Python, so each level adds frames of C.
        list(map(lambda _: call_deeper(levels - 1, function), (None,)))  # noqa: C417


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
