"""Where the machine code of a release lies: placements, and their order over launches.

What decides the speed of a loop is first its position within a cache line of 64 bytes. Sections are
aligned to 16 bytes, so there are four residues, and a linker could have chosen any of them. A
placement moves all libraries that a step runs through to one residue, and each by a random number
of whole lines besides. Linux loads large libraries at multiples of 2 MiB, and branch predictors
tell branches apart by some low bits of their addresses; so the lines are drawn from as much.
"""

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

PAGE_BYTES, CACHE_LINE_BYTES = 4096, 64
# Linux maps libraries that are larger at multiples of this.
HUGE_PAGE_BYTES = 1 << 21
# Sections are aligned to as much.
STEP_BYTES = 16
RESIDUES = range(0, CACHE_LINE_BYTES, STEP_BYTES)


@dataclass(frozen=True)
class Placement:
    """How far the libraries of a release are moved from where they were built for.

    Attributes:
      engine_bytes: of libmujoco.
      extension_bytes: of the extension modules of the Python package.

    Raises:
      ValueError: one is not a multiple of STEP_BYTES below HUGE_PAGE_BYTES.
    """

    engine_bytes: int
    extension_bytes: int

    def __post_init__(self) -> None:
        for shift in (self.engine_bytes, self.extension_bytes):
            if shift not in range(0, HUGE_PAGE_BYTES, STEP_BYTES):
                raise ValueError(f"cannot move a library by {shift} bytes")

    @property
    def residue(self) -> int:
        """Bytes by which the libraries are moved within a cache line."""
        return self.engine_bytes % CACHE_LINE_BYTES

    @classmethod
    def draw(cls, residue: int, rng: random.Random) -> "Placement":
        lines = range(0, HUGE_PAGE_BYTES, CACHE_LINE_BYTES)
        return cls(residue + rng.choice(lines), residue + rng.choice(lines))


@dataclass(frozen=True)
class PlacementPair:
    """The placements of the baseline and of the candidate in one launch; None is as shipped."""

    old: Placement | None = None
    new: Placement | None = None

    @property
    def is_moved(self) -> bool:
        return self.old is not None and self.new is not None

    @property
    def residue(self) -> int:
        """Bytes by which the candidate is moved within a cache line; 0 as shipped."""
        return self.new.residue if self.new is not None else 0


AS_SHIPPED = PlacementPair()


# To so many launches that move the libraries comes one as shipped.
_MOVED_PER_SHIPPED = 2 * len(RESIDUES)


def schedule(rng: random.Random) -> Iterator[PlacementPair]:
    """Yield the placements of one launch after the other, endlessly.

    Of every nine launches one is as shipped, but never the first or the last of them. The other
    eight take every residue twice, in random order, the second time after the first. Both sides are
    moved by as much: then identical code is placed alike, and each residue adds one unknown to the
    comparison.
    """
    while True:
        residues = [*rng.sample(RESIDUES, len(RESIDUES)), *rng.sample(RESIDUES, len(RESIDUES))]
        placements = [Placement.draw(residue, rng) for residue in residues]
        block = [PlacementPair(placement, placement) for placement in placements]
        block.insert(rng.randrange(1, len(block)), AS_SHIPPED)
        yield from block


def launches_with(moved: int) -> int:
    """Return the number of launches of a `schedule` that hold at least `moved` moved ones."""
    return moved + math.ceil((moved - 1) / _MOVED_PER_SHIPPED)
