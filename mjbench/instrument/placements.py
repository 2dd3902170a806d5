"""In which order launches move the libraries of both sides, so that placement averages out.

Where code lies in memory makes a process faster or slower. A loop's position within its cache line
(the *residue* of its address modulo 64) matters most; its position within the page matters less.
A launch moves the libraries of both sides by the same number of bytes: identical code then has
identical placements, and two different libraries need one parameter per residue, not two.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

# Positions within a cache line of 64 bytes that code, which is aligned to 16, can take.
RESIDUES = 4


@dataclass(frozen=True)
class Placement:
    """By how much a launch moves the libraries of both sides.

    Attributes:
      residue: index of the number of bytes modulo 64.
      image: index among the numbers of bytes that have this residue.
    """

    residue: int
    image: int = 0


def design(rng: np.random.Generator, images: int, residues: int = RESIDUES) -> Iterator[Placement]:
    """Yield the placements of launches, without end.

    Each block of `residues` launches has each residue once, in random order. Of each residue's
    images, none is used again before all have been used: every image is used once in each
    `residues * images` launches.

    Args:
      rng: draws the orders.
      images: number of images of each residue.
      residues: number of residues.

    Raises:
      ValueError: there is no image or no residue.
    """
    if images < 1 or residues < 1:
        raise ValueError(f"need images and residues, got {images} and {residues}")
    while True:
        orders = rng.permuted(np.tile(np.arange(images), (residues, 1)), axis=1)
        for block in range(images):
            for residue in rng.permutation(residues):
                yield Placement(int(residue), int(orders[residue, block]))
