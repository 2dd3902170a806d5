"""Where code lies, launch by launch."""

import itertools
import random

import pytest

from mjbench.releases import placement
from mjbench.releases.placement import AS_SHIPPED, RESIDUES, Placement


@pytest.mark.parametrize("seed", range(5))
def test_of_nine_launches_each_side_takes_every_residue_twice_and_one_is_as_shipped(
    seed: int,
) -> None:
    pairs = list(itertools.islice(placement.schedule(random.Random(seed)), 90))
    for begin in range(0, 90, 9):
        block = pairs[begin : begin + 9]
        moved = [pair for pair in block if pair.is_moved]
        assert block.count(AS_SHIPPED) == 1
        assert block[0].is_moved
        assert block[-1].is_moved
        for side in ("old", "new"):
            residues = [getattr(pair, side).residue for pair in moved]
            assert sorted(residues[:4]) == sorted(residues[4:]) == list(RESIDUES)


def test_both_sides_are_placed_alike_and_libraries_independently_within_their_pages() -> None:
    pairs = [p for p in itertools.islice(placement.schedule(random.Random(1)), 200) if p.is_moved]
    assert all(pair.old == pair.new for pair in pairs)
    old = [pair.old for pair in pairs if pair.old]
    assert all(p.engine_bytes % 64 == p.extension_bytes % 64 == p.residue for p in old)
    assert len({p.engine_bytes - p.extension_bytes for p in old}) > 20


@pytest.mark.parametrize("moved", range(1, 13))
def test_a_number_of_launches_holds_as_many_moved_ones_in_every_order(moved: int) -> None:
    count = placement.launches_with(moved)
    moved_counts = [
        sum(p.is_moved for p in itertools.islice(placement.schedule(random.Random(seed)), count))
        for seed in range(100)
    ]
    assert min(moved_counts) == moved


@pytest.mark.parametrize("shift", [-16, 8, 1 << 21])
def test_a_library_moves_by_whole_steps_within_a_huge_page(shift: int) -> None:
    with pytest.raises(ValueError, match=f"by {shift} bytes"):
        Placement(shift, 0)
