"""Searches of the releases: what is measured is drawn from the committed history of releases."""

import random
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from verdict_records import SAME, SLOWER, launch

from benchmarks.history.release_ratios import StepRatioRecord
from mjbench.paired import bisect_search, release_bisect, verdict
from mjbench.paired.bisect_records import VersionKind, VersionRow
from mjbench.paired.bisect_search import SearchRange, VersionMeasurer
from mjbench.paired.records import VerdictRecord
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.releases import installs
from mjbench.releases.catalogue import ReleaseRange
from mjbench.releases.release_names import ReleaseSpec
from mjbench.report.kinds import RECORD_TYPES
from mjbench.simulation import models
from mjbench.store import runs

HISTORY = Path(__file__).parents[2] / "results/history/reference-ratios.jsonl"


@dataclass
class OfHistory(VersionMeasurer):
    """Releases as the history measured them, launch by launch; the truth is theirs.

    A launch is as far from the truth as one of either release was from its mean.

    Attributes:
      log_ratios_of: of the launches of each release over the reference.
    """

    log_ratios_of: Sequence[Sequence[float]]
    at_hand: frozenset[int]
    rng: random.Random
    comparisons: list[tuple[int, int]] = field(default_factory=list)

    def decide(self, baseline: int, candidate: int) -> VerdictRecord:
        log_ratios: list[float] = []
        judged = None
        while judged is None or not (judged.enough or judged.launches >= 60):
            log_ratios.append(self._draw(baseline, candidate))
            judged = verdict.judge(log_ratios, 0.01, 0.99, 0.005)
        self.comparisons.append((baseline, candidate))
        launches = [launch(log_ratio) for log_ratio in log_ratios]
        return replace(SAME, verdict=judged.verdict, ratio=judged.ratio, samples=launches)

    def log_ratios(self, baseline: int, candidate: int, count: int) -> Sequence[float]:
        self.comparisons.append((baseline, candidate))
        return [self._draw(baseline, candidate) for _ in range(count)]

    def ready(self) -> frozenset[int]:
        return self.at_hand

    def _draw(self, baseline: int, candidate: int) -> float:
        launches = [self.log_ratios_of[number] for number in (baseline, candidate)]
        old, new = map(statistics.mean, launches)
        measured = self.rng.choice(launches)
        return new - old + self.rng.choice(measured) - statistics.mean(measured)


@pytest.fixture(scope="module")
def cartpole() -> list[StepRatioRecord]:
    """Return how long the cart-pole's steps take in all releases of the history."""
    ratios = runs.load(HISTORY, RECORD_TYPES).of_type(StepRatioRecord)
    return [record for record in ratios if record.model == "cartpole"]


@pytest.mark.parametrize("seed", range(10))
def test_the_release_that_slowed_the_cart_pole_is_found_among_42_in_ten_comparisons(
    cartpole: list[StepRatioRecord], seed: int
) -> None:
    rng = random.Random(seed)
    log_ratios = [
        [each.log_ratio for each in record.launches if each.placement] for record in cartpole
    ]
    at_hand = frozenset(rng.sample(range(1, len(cartpole)), 5))
    measurer = OfHistory(log_ratios, at_hand, rng)
    versions = [VersionRow(n, record.release) for n, record in enumerate(cartpole) if n]
    searched = SearchRange("cartpole", VersionKind.RELEASE, "2.3.7", "4.0.0", versions)
    assert len(cartpole) == 42
    *_, result = bisect_search.search(measurer, searched, 0.01)
    assert [change.version.name for change in result.changes] == ["3.3.1"]
    assert len(measurer.comparisons) <= 10


class Times:
    """Stands for measured releases of which the third and later ones are slow."""

    VERSIONS = "3.2.7", "3.3.0", "3.3.1", "3.3.2"

    def __init__(self) -> None:
        self.measured: list[str] = []

    def log_ratio(self, baseline: Target, candidate: Target) -> float:
        numbers = [self.VERSIONS.index(each.release.version) for each in (baseline, candidate)]
        return 0.03 if numbers[0] < 2 <= numbers[1] else 0.0

    def decide(self, pool: Any, baseline: Target, candidate: Target, plan: VerdictPlan) -> Any:
        is_slower = self.log_ratio(baseline, candidate) > 0
        sides = {"old": baseline.release.version, "new": candidate.release.version}
        record = replace(SLOWER if is_slower else SAME, samples=[launch(0.03)] * 3, **sides)

        return SimpleNamespace(status=record.status, record=lambda: record)

    def launch_log_ratios(
        self, pool: Any, baseline: Target, candidate: Target, plan: VerdictPlan, count: int
    ) -> list[float]:
        self.measured.append(candidate.release.version)
        return [self.log_ratio(baseline, candidate)] * count


@pytest.fixture
def times(monkeypatch: pytest.MonkeyPatch) -> Times:
    times = Times()
    monkeypatch.setattr(verdict, "decide", times.decide)
    monkeypatch.setattr(verdict, "launch_log_ratios", times.launch_log_ratios)
    return times


def release_range(index_problem: str = "") -> ReleaseRange:
    return ReleaseRange([ReleaseSpec(v, v) for v in Times.VERSIONS], index_problem)


def test_a_change_of_a_shipped_model_stands_with_what_is_known_of_it(times: Times) -> None:
    *_, record = release_bisect.search(release_range(), models.resolve("cartpole"), VerdictPlan())
    (change,) = record.changes
    assert (record.kind, record.old, record.new) == (VersionKind.RELEASE, "3.2.7", "3.3.2")
    assert (change.version.name, change.verdict.old) == ("3.3.1", "3.3.0")
    assert "a timer" in change.known_causes[0]


def test_without_an_index_only_installed_releases_are_measured(
    times: Times, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = ReleaseSpec("3.3.1", "3.3.1").key
    monkeypatch.setattr(installs, "install_names", lambda: [installed])
    source = models.resolve("cartpole")
    *_, record = release_bisect.search(release_range("no network"), source, VerdictPlan())
    assert times.measured == ["3.3.1"]
    assert {trial.detail for trial in record.trials if trial.ratio is None} <= {
        "not installed here, and no network"
    }
