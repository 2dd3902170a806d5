"""The versions that changed the time of something; measurements are invented."""

import itertools
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import pytest
from verdict_records import FAILED, SAME, launch

from mjbench.errors import MachineError
from mjbench.measuring.ratio import Ratio
from mjbench.paired import bisect_search
from mjbench.paired.bisect_records import (
    BisectComparison,
    BisectMeasured,
    BisectRecord,
    BisectTrial,
    VersionKind,
    VersionRow,
    finished,
)
from mjbench.paired.bisect_search import SearchRange, VersionMeasurer
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord


@dataclass
class Invented(VersionMeasurer):
    """Versions whose times are known.

    Attributes:
      steps: log ratio of a version over the one before it, by its number.
      broken: versions that cannot be measured.
      at_hand: versions that need not be installed.
    """

    steps: dict[int, float]
    broken: frozenset[int] = frozenset()
    at_hand: frozenset[int] = frozenset()
    deviation: float = 0.01
    decided: list[tuple[int, int]] = field(default_factory=list)
    measured: list[int] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(4))

    def decide(self, baseline: int, candidate: int) -> VerdictRecord:
        self.decided.append((baseline, candidate))
        if {baseline, candidate} & self.broken:
            return FAILED
        truth = self._truth(baseline, candidate)
        launches = [launch(truth + self.rng.gauss(0, self.deviation)) for _ in range(10)]
        low, estimate, high = (math.exp(truth + d) for d in (-0.004, 0.0, 0.004))
        verdict = Verdict.SAME
        if abs(truth) > 0.005:
            verdict = Verdict.SLOWER if truth > 0 else Verdict.FASTER
        return replace(SAME, verdict=verdict, ratio=Ratio(estimate, low, high), samples=launches)

    def log_ratios(self, baseline: int, candidate: int, count: int) -> Sequence[float]:
        if candidate in self.broken:
            raise MachineError("cannot build it")
        self.measured.append(candidate)
        truth = self._truth(baseline, candidate)
        return [truth + self.rng.gauss(0, self.deviation) for _ in range(count)]

    def ready(self) -> frozenset[int]:
        return self.at_hand

    def _truth(self, baseline: int, candidate: int) -> float:
        return sum(step for number, step in self.steps.items() if baseline < number <= candidate)


def search(
    measurer: Invented, count: int, earlier: Sequence[BisectMeasured] = ()
) -> Iterator[BisectMeasured]:
    commits = [VersionRow(n, f"{n:040x}", f"commit {n}") for n in range(1, count + 1)]
    searched = SearchRange("bench.py::step", VersionKind.COMMIT, "old", "new", commits)
    return bisect_search.search(measurer, searched, 0.01, earlier, itertools.count().__next__)


def searched_to_its_end(measurer: Invented, count: int) -> BisectRecord:
    *_, record = search(measurer, count)
    assert isinstance(record, BisectRecord)
    return record


@pytest.mark.parametrize("truth", [1, 2, 31, 63, 64])
def test_the_first_slower_commit_is_found_among_64(truth: int) -> None:
    measurer = Invented({truth: 0.05})
    result = searched_to_its_end(measurer, 64)
    assert [change.version.number for change in result.changes] == [truth]
    assert result.changes[0].verdict.verdict == Verdict.SLOWER
    assert measurer.decided == [(0, 64), (truth - 1, truth)]
    assert len(measurer.measured) <= 10


def test_a_faster_commit_is_found_likewise() -> None:
    (change,) = searched_to_its_end(Invented({9: -0.05}), 20).changes
    assert (change.version.number, change.verdict.verdict) == (9, Verdict.FASTER)


def test_versions_at_hand_are_preferred() -> None:
    measurer = Invented({21: 0.05}, at_hand=frozenset({12, 25}))
    result = searched_to_its_end(measurer, 42)
    assert [change.version.number for change in result.changes] == [21]
    assert set(measurer.measured[:2]) == {12, 25}
    assert len(measurer.measured) <= 8


def test_ends_that_do_not_differ_end_the_search() -> None:
    measurer = Invented({})
    result = searched_to_its_end(measurer, 64)
    assert (result.changes, result.trials, measurer.measured) == ([], [], [])
    assert result.ends.verdict == Verdict.SAME


@pytest.mark.parametrize(
    "steps", [{10: 0.06, 40: 0.06}, {10: 0.08, 40: 0.04}, {31: 0.05, 32: 0.05}, {3: 0.1, 60: -0.05}]
)
def test_two_steps_are_found_as_two(steps: dict[int, float]) -> None:
    result = searched_to_its_end(Invented(steps), 64)
    assert [change.version.number for change in result.changes] == sorted(steps)


def test_neighbours_are_compared_once() -> None:
    measurer = Invented({1: 0.05})
    (change,) = searched_to_its_end(measurer, 1).changes
    assert (change.version.number, measurer.decided) == (1, [(0, 1)])


@pytest.mark.parametrize(
    ("broken", "number", "skipped"),
    [
        (frozenset({18, 19}), 20, [18, 19]),
        (frozenset({20}), 21, [20]),
        (frozenset(range(2, 20)), 20, [*range(2, 20)]),
    ],
)
def test_commits_that_cannot_be_measured_are_named_with_the_change(
    broken: frozenset[int], number: int, skipped: list[int]
) -> None:
    measurer = Invented({20: 0.05}, broken=broken)
    result = searched_to_its_end(measurer, 40)
    (change,) = result.changes
    assert change.version.number == number
    assert [row.number for row in change.skipped] == skipped
    assert len(measurer.measured) <= 12


def test_a_change_that_is_spread_over_many_commits_is_not_pinned_on_one() -> None:
    result = searched_to_its_end(Invented(dict.fromkeys(range(1, 33), 0.002)), 32)
    assert result.changes == []
    assert result.detail.startswith("likely, but not confirmed: ")


def test_a_search_that_is_continued_measures_only_the_rest() -> None:
    *measured, whole = search(Invented({31: 0.05, 50: 0.08}, broken=frozenset({32})), 64)
    assert len(measured) > 8
    for count in range(len(measured) + 1):
        again = Invented({31: 0.05, 50: 0.08}, broken=frozenset({32}))
        again.rng.seed(count)
        earlier = finished(measured[:count])
        *rest, record = search(again, 64, earlier)
        known = {(each.first, each.last) for each in earlier if isinstance(each, BisectComparison)}
        assert not known & set(again.decided)
        assert all(
            each.version.number not in again.measured
            for each in earlier
            if isinstance(each, BisectTrial)
        )
        assert record.changes == whole.changes
        assert record.seconds == len(earlier) + len(rest)
        assert finished([*earlier, *rest, record]) == [*earlier, *rest, record]


@pytest.mark.parametrize("seed", range(3))
def test_a_trial_counts_once_where_a_noisy_search_is_continued(seed: int) -> None:
    noisy = Invented({31: 0.05}, deviation=0.1)
    noisy.rng.seed(seed)
    *measured, whole = search(noisy, 64)
    trials = [each for each in measured if isinstance(each, BisectTrial)]
    assert len({each.version.number for each in trials}) < len(trials)
    *rest, again = search(Invented({31: 0.05}, deviation=0.1), 64, measured)
    assert isinstance(whole, BisectRecord)
    assert isinstance(again, BisectRecord)
    assert rest == []
    assert again.trials == whole.trials == trials
    assert again.changes == whole.changes


def test_what_could_not_be_measured_is_tried_again() -> None:
    measured = search(Invented({20: 0.05}, broken=frozenset({20})), 40)
    failed = [each for each in measured if isinstance(each, BisectTrial) and each.detail]
    assert len(failed) == 1
    assert finished(failed) == []
