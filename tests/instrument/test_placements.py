from collections import Counter
from itertools import islice

import numpy as np
import pytest

from mjbench.instrument.placements import RESIDUES, Placement, design


@pytest.mark.parametrize("images", [1, 3, 16])
def test_blocks_have_every_residue_and_cycles_every_image(images: int) -> None:
    order = design(np.random.default_rng(0), images)
    every = {Placement(r, i) for r in range(RESIDUES) for i in range(images)}
    for _ in range(3):
        cycle = list(islice(order, RESIDUES * images))
        assert Counter(cycle) == Counter(every)
        for start in range(0, len(cycle), RESIDUES):
            block = cycle[start : start + RESIDUES]
            assert {p.residue for p in block} == set(range(RESIDUES))


def test_orders_are_random() -> None:
    cycles = islice(design(np.random.default_rng(0), images=2), 20 * 8)
    values = list(cycles)
    assert len({tuple(values[i : i + 8]) for i in range(0, len(values), 8)}) > 10


def test_a_design_needs_an_image() -> None:
    with pytest.raises(ValueError, match="need images"):
        next(design(np.random.default_rng(0), images=0))
