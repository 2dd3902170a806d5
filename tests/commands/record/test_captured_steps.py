"""Windows are spread evenly over a run of any length, and are never too many."""

import itertools
import random

import numpy as np
import pytest

from mjbench.commands.record.captured_steps import WindowSample

NSTEP = 10


def begins(length: int, most: int, seed: int = 0, phase: int = 1) -> list[int]:
    """Return where the windows begin that are kept of a run.

    A window can begin only at every `phase`th step, as where a call takes several.
    """
    sample: WindowSample[int] = WindowSample(most, NSTEP, random.Random(seed))
    step = 0
    while (step := max(step, sample.due // phase * phase)) < length:
        begin = step
        step += NSTEP
        sample.add(begin, step)
    return sample.windows()


def test_a_short_run_is_kept_whole() -> None:
    assert begins(8 * NSTEP, 8) == list(range(0, 8 * NSTEP, NSTEP))


@pytest.mark.parametrize("most", [1, 2, 7, 100])
@pytest.mark.parametrize("length", [1, 10, 95, 1_000, 123_456])
def test_windows_are_in_order_apart_and_no_more_than_asked_for(most: int, length: int) -> None:
    windows = begins(length, most)
    assert 1 <= len(windows) <= most
    assert len(windows) >= min(most // 2, length // NSTEP)  # strata are merged in pairs
    assert all(later - earlier >= NSTEP for earlier, later in itertools.pairwise(windows))


def test_windows_are_everywhere_in_the_run_with_equal_density() -> None:
    length = 100_000
    places = np.concatenate([begins(length, 20, seed) for seed in range(200)]) / length
    shares, _ = np.histogram(places, bins=10, range=(0, 1))
    assert shares.min() > 0.7 * shares.mean()
    assert shares.max() < 1.3 * shares.mean()


def test_windows_of_a_program_with_episodes_meet_every_part_of_an_episode() -> None:
    """At fixed distances of 10 · 2ᵏ steps, all would begin with the episode."""
    episode = 10 * 2**7
    parts = np.array(begins(1_000_000, 100)) % episode
    shares, _ = np.histogram(parts, bins=4, range=(0, episode))
    assert shares.min() >= 5


def test_a_window_begins_as_soon_as_the_program_can_after_it_was_due() -> None:
    assert all(begin % 7 == 0 for begin in begins(10_000, 10, phase=7))


def test_a_window_that_ends_late_is_followed_by_a_later_one() -> None:
    """Where many simulations take turns, a window of one spans many steps of all."""
    sample: WindowSample[str] = WindowSample(100, NSTEP, random.Random(0))
    sample.add("first", 80)
    assert sample.due >= 80
    sample.add("second", 240)
    assert sample.windows() == ["first", "second"]
    assert sample.due >= 240
