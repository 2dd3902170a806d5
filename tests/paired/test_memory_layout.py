"""What the workers of a launch have in common."""

import itertools
import random

import pytest

from mjbench.host import platforms
from mjbench.paired import memory_layout


def test_programs_last_for_some_launches_and_the_seed_of_memory_for_one() -> None:
    drawn = [*itertools.islice(memory_layout.schedule(random.Random(0), 3), 7)]
    programs = [each.program for each in drawn]
    assert [len([*group]) for _, group in itertools.groupby(programs)] == [3, 3, 1]
    assert len({each.memory for each in drawn}) == len(drawn)
    assert all(0 <= seed < 2**32 for seed in programs)  # what PYTHONHASHSEED can be


@pytest.mark.parametrize(
    ("can_adopt", "can_fix", "expected"),
    [
        (True, True, memory_layout.FIXED_LAUNCHES),
        (True, False, memory_layout.RANDOM_LAUNCHES),
        (False, False, 1),
        (False, True, 1),
    ],
)
def test_programs_last_longer_where_they_fork_and_their_addresses_are_fixed(
    monkeypatch: pytest.MonkeyPatch, can_adopt: bool, can_fix: bool, expected: int
) -> None:
    monkeypatch.setattr(platforms, "can_adopt", lambda: can_adopt)
    monkeypatch.setattr(platforms, "can_fix_addresses", lambda: can_fix)
    assert memory_layout.launches_of_a_program() == expected
