"""The spread of a step's time over placements, from launches whose truth is known."""

import itertools
import math
import random
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from paired_examples import CARTPOLE, InventedPair

from mjbench.paired import moved_check, placement_spread
from mjbench.paired.placement_spread import MIN_LAUNCHES, SpreadPlan, SpreadRecord
from mjbench.paired.records import LaunchRow
from mjbench.releases.moved_install import ImmovableError
from mjbench.releases.placement import RESIDUES, Placement, PlacementPair
from mjbench.status import Status
from mjbench.store.json_form import json_form
from mjbench.store.runs import to_json

# How much slower a step is at each residue.
TRUTH = {0: 0.0, 16: 0.04, 32: -0.01, 48: 0.02}


def launch(pair: PlacementPair, log_ratio: float) -> LaunchRow:
    """Return a launch of one quad with a log ratio."""
    ns = np.array([[1e9, 1e9 * math.exp(log_ratio), 1e9 * math.exp(log_ratio), 1e9]])
    return LaunchRow(0, None, ["ABBA"], ns.tolist(), pair, [1])


def launches(count: int, truth: dict[int, float], deviation: float = 0.003) -> list[LaunchRow]:
    """Return launches of the schedule, with noise."""
    rng, noise = random.Random(3), np.random.default_rng(3)
    pairs = itertools.islice(placement_spread.schedule(rng), count)
    return [
        launch(pair, truth[pair.new.residue] + deviation * noise.standard_normal())
        for pair in pairs
        if pair.new
    ]


def spread(measured: Sequence[LaunchRow]) -> Any:
    return placement_spread.spread_of(placement_spread.residue_rows(measured))


def test_of_four_launches_each_takes_another_residue_and_the_baseline_is_as_shipped() -> None:
    pairs = list(itertools.islice(placement_spread.schedule(random.Random(1)), 40))
    assert all(pair.old is None for pair in pairs)
    placements = [pair.new for pair in pairs if pair.new]
    for begin in range(0, 40, 4):
        assert sorted(p.residue for p in placements[begin : begin + 4]) == list(RESIDUES)
    assert len({p.engine_bytes // 64 for p in placements}) > 20
    assert len({tuple(p.residue for p in placements[i : i + 4]) for i in range(0, 40, 4)}) > 3


def test_each_residue_has_its_own_estimate_and_interval() -> None:
    rows = placement_spread.residue_rows(launches(56, TRUTH))
    assert [(row.residue, row.launches) for row in rows] == [(r, 14) for r in RESIDUES]
    for row in rows:
        truth = math.exp(TRUTH[row.residue])
        assert row.ratio.estimate == pytest.approx(truth, abs=0.005)
        assert row.ratio.low is not None
        assert row.ratio.high is not None
        assert row.ratio.low < truth < row.ratio.high


def test_the_spread_is_from_the_fastest_residue_to_the_slowest() -> None:
    found = spread(launches(56, TRUTH))
    truth = math.expm1(0.05)
    assert found.estimate == pytest.approx(truth, abs=0.005)
    assert 0.03 < found.low < truth < found.high < 0.07


def test_where_intervals_overlap_no_dependence_was_seen() -> None:
    found = spread(launches(56, dict.fromkeys(RESIDUES, 0.01)))
    assert found.low == 0.0
    assert 0 < found.estimate < found.high < 0.02


def test_code_whose_place_does_not_matter_is_hardly_ever_said_to_depend_on_it() -> None:
    noise, same = np.random.default_rng(7), dict.fromkeys(RESIDUES, 0.0)
    pairs = [launch_.placements for launch_ in launches(56, same)]
    lows = [
        spread([launch(pair, 0.006 * noise.standard_normal()) for pair in pairs]).low
        for _ in range(100)
    ]
    assert sum(low > 0 for low in lows) <= 1


def test_few_launches_give_a_spread_without_an_interval() -> None:
    for count in (MIN_LAUNCHES - 1, MIN_LAUNCHES):
        found = spread(launches(4 * count, TRUTH))
        assert found.estimate > 0.03
        assert (found.high is not None) == (count == MIN_LAUNCHES)


def test_without_a_launch_of_every_residue_there_is_no_spread() -> None:
    assert spread(launches(3, TRUTH)) is None
    assert spread([]) is None


# When it stops.


class Clock:
    """A clock that a launch moves by a second."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[[SpreadPlan], tuple[int, str]]:
    """Return what says how many launches a plan makes, and what is said of it."""
    clock = Clock()

    def invent() -> LaunchRow:
        clock.now += 1.0
        return launch(PlacementPair(None, Placement(0, 0)), 0.0)

    monkeypatch.setattr(
        placement_spread,
        "TargetPair",
        lambda pool, old, new, sizes, time_limit: InventedPair(time_limit, invent),
    )
    monkeypatch.setattr(moved_check, "check", lambda pool, release: None)

    def measure(plan: SpreadPlan) -> tuple[int, str]:
        pool: Any = None
        counts: list[int] = []
        record = placement_spread.measure(pool, CARTPOLE, plan, counts.append, clock)
        assert record.status == Status.OK
        assert counts == list(range(1, record.launches + 1))
        return record.launches, record.detail

    return measure


Launched = Callable[[SpreadPlan], tuple[int, str]]


def test_every_residue_gets_its_launches(launched: Launched) -> None:
    assert launched(SpreadPlan(launches=10, time_limit_s=1e9)) == (40, "")
    assert launched(SpreadPlan(launches=1, time_limit_s=1e9)) == (4, "")


def test_time_runs_out_with_what_was_measured(launched: Launched) -> None:
    expected = 40, "time ran out after 40 of 56 launches"
    assert launched(SpreadPlan(launches=14, time_limit_s=40.0)) == expected
    count, detail = launched(SpreadPlan(launches=14, time_limit_s=10.0))
    assert count == 10
    assert detail == (
        "a launch takes about 1 s, and a spread needs at least 36 launches:"
        " give --budget 45s or more"
    )


def raising(error: BaseException) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("error", "status", "detail"),
    [
        (ImmovableError("it is a program"), Status.FAILED, "its code cannot be moved: it is a"),
        (KeyboardInterrupt(), Status.INTERRUPTED, "interrupted"),
    ],
)
def test_a_release_that_cannot_be_measured_says_why(
    monkeypatch: pytest.MonkeyPatch, error: BaseException, status: Status, detail: str
) -> None:
    monkeypatch.setattr(moved_check, "check", raising(error))
    pool: Any = None
    record = placement_spread.measure(pool, CARTPOLE, SpreadPlan(launches=14, time_limit_s=180.0))
    assert (record.status, record.launches, record.spread) == (status, 0, None)
    assert record.detail.startswith(detail)
    assert placement_spread.finished([record]) == []


def test_documents_have_no_samples() -> None:
    samples = launches(4, TRUTH)
    record = SpreadRecord(
        model="m", release="4.0.0", build="b", status=Status.OK, launches=4, samples=samples
    )
    assert json_form(record) == {k: v for k, v in to_json(record).items() if k != "samples"}
    assert placement_spread.finished([record, "another"]) == [record]
