"""Which variants go on in a contest of fresh processes, and which one it chooses."""

import random
from collections.abc import Sequence
from types import TracebackType

import numpy as np
import pytest

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.errors import MachineError
from mjbench.paired import contest
from mjbench.paired.confirmation import ComparedSizes
from mjbench.paired.contest import ContestLaunch, ContestRecord, remaining
from mjbench.paired.time_limit import OutOfTimeError
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.simulation.workload import Product
from mjbench.status import Status

SOURCE = models.resolve("cartpole")
SIZES = ComparedSizes(8, 10, 1e-6)


def launches(
    rng: np.random.Generator, times: Sequence[float], count: int, noise: float
) -> list[ContestLaunch]:
    """Return launches in which variants take these times, with normal noise of their logarithm."""
    return [
        ContestLaunch(
            None,
            range(len(times)),
            [
                [
                    max(1, round(1e6 * time * factor))
                    for time, factor in zip(times, row, strict=True)
                ]
                for row in np.exp(noise * rng.normal(size=(8, 1)) + 0.02 * rng.normal(size=(8, 3)))
            ],
        )
        for _ in range(count)
    ]


def test_the_order_of_a_round_does_not_matter() -> None:
    # the block that comes second takes 10 % longer; both take as long otherwise
    first, second = [1_000, 1_100], [1_100, 1_000]
    launch = ContestLaunch(None, [4, 7], [first, second, first, second])
    assert launch.log_ratio(4, 7) == pytest.approx(0.0)
    disturbed = ContestLaunch(None, [4, 7], [first, second, first, [9_000, 1_000], first, second])
    assert disturbed.log_ratio(4, 7) == pytest.approx(0.0)


def test_those_that_are_certainly_slower_leave_and_nobody_leaves_early() -> None:
    drawn = launches(np.random.default_rng(1), (1.0, 0.51, 0.5), 8, noise=0.05)
    assert remaining(drawn[:7], [[0, 1, 2]]) == [0, 1, 2]
    slow = launches(np.random.default_rng(1), (0.5, 0.9, 0.505), 8, noise=0.05)
    assert 1 not in remaining(slow, [[0, 1, 2]])


def test_a_group_is_over_when_it_is_certain_and_others_go_on() -> None:
    drawn = launches(np.random.default_rng(2), (1.0, 0.5, 0.8), 40, noise=0.05)
    assert remaining(drawn, [[0, 1], [0, 2]]) == []
    noisy = [
        ContestLaunch(
            None,
            launch.variants,
            [[a, b, round(c * factor)] for a, b, c in launch.ns],
        )
        for launch, factor in zip(
            drawn, np.exp(0.3 * np.random.default_rng(3).normal(size=40)), strict=True
        )
    ]
    assert remaining(noisy, [[0, 1], [0, 2]]) == [0, 2]


def test_the_fastest_is_rarely_thrown_out() -> None:
    rng, thrown_out = np.random.default_rng(4), 0
    for _ in range(100):
        drawn = launches(rng, (1.0, 0.5, 0.5), 20, noise=0.1)
        for count in range(8, 21):
            going_on = remaining(drawn[:count], [[0, 1, 2]])
            if going_on and not {1, 2} & set(going_on):
                thrown_out += 1
    assert thrown_out == 0


def test_the_simplest_within_three_percent_is_chosen() -> None:
    variants = [Variant(name, {}) for name in ("python_loop", "rollout", "threads")]
    for time, chosen in ((0.49, 1), (0.48, 2)):
        drawn = launches(np.random.default_rng(5), (1.0, 0.5, time), 40, noise=0.05)
        record = ContestRecord(model="m", variants=variants, status=Status.OK, launches=drawn)
        assert record.choice(variants) == variants[chosen]
        assert record.fastest(variants) == variants[2]
        ratio = record.ratio(variants[0], variants[2])
        assert ratio is not None
        assert ratio.low is not None
        assert ratio.high is not None
        assert ratio.low < time < ratio.high


def test_variants_that_never_met_have_no_ratio() -> None:
    variants = [Variant("python_loop", {}), Variant("rollout", {})]
    alone = ContestLaunch(None, [0], [[1_000], [1_000]])
    both = ContestLaunch(None, [0, 1], [[1_000, 500], [1_000, 500]])
    record = ContestRecord(model="m", variants=variants, status=Status.OK, launches=[alone])
    assert record.ratio(*variants) is None
    again = ContestRecord(model="m", variants=variants, status=Status.OK, launches=[both])
    ratio = again.ratio(*variants)
    assert ratio is not None
    assert (ratio.estimate, ratio.low) == (pytest.approx(0.5), None)


def test_fresh_processes_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contest, "MIN_LAUNCHES", 1)
    monkeypatch.setattr(contest, "remaining", lambda launches, groups: [])
    groups = [[Variant("python_loop", {}), Variant("rollout", {"threads": 2, "pool": "kept"})]]
    with WorkerPool() as pool:
        record = contest.run(pool, SOURCE, ComparisonPlan(()), groups, SIZES)
        assert not list(pool.new_file("").parent.glob("*.mjb"))
    assert record.status == Status.OK
    assert record.variants == groups[0]
    (launch,) = record.launches
    assert np.shape(launch.ns) == (contest.LAYOUTS * contest.ROUNDS, 2)
    assert launch.cores is not None


def test_a_path_that_fails_ends_the_contest_with_its_name() -> None:
    groups = [[Variant("python_loop", {}), Variant("rollout", {"threads": -1, "pool": "kept"})]]
    with WorkerPool() as pool:
        record = contest.run(pool, SOURCE, ComparisonPlan(()), groups, SIZES)
    assert record.status in (Status.FAILED, Status.INPUT)
    assert "rollout threads=-1" in record.detail


def test_a_path_that_cannot_run_beside_others_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contest, "remaining", lambda launches, groups: [])
    # such a step leaves the sensor data of the state after it
    broken = Variant("batch_step", {"threads": 2, "data": "shared", "stage": "vel"})
    groups = [[Variant("python_loop", {}), broken, Variant("rollout", {"threads": 1})]]
    plan = ComparisonPlan((), returns=Product.SENSORS)
    with WorkerPool() as pool:
        record = contest.run(pool, SOURCE, plan, groups, SIZES)
    assert record.status == Status.OK
    (launch,) = record.launches
    assert list(launch.variants) == [0, 2]
    assert record.ratio(groups[0][0], broken) is None
    (unable,) = record.unable
    assert unable.variant == 1
    assert record.why_unable(broken) == unable.detail
    assert "sensor" in unable.detail
    assert record.why_unable(groups[0][0]) == ""


def test_the_first_of_a_group_may_leave_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contest, "MIN_LAUNCHES", 1)
    broken = Variant("batch_step", {"threads": 2, "data": "shared", "stage": "vel"})
    loop, rollout = Variant("python_loop", {}), Variant("rollout", {"threads": 1})
    plan = ComparisonPlan((), returns=Product.SENSORS)
    shares: list[tuple[int, float]] = []
    with WorkerPool() as pool:
        record = contest.run(
            pool,
            SOURCE,
            plan,
            [[loop, rollout], [broken, rollout]],
            SIZES,
            time_limit_s=1e-6,
            on_launch=lambda launches, share: shares.append((launches, share)),
        )
    assert record.status == Status.OK
    assert [each.variant for each in record.unable] == [2]
    assert [list(launch.variants) for launch in record.launches] == [[0, 1]]
    assert shares == [(1, 1.0)]


def test_a_first_one_that_left_is_not_needed_again() -> None:
    noisy = np.random.default_rng(3)
    drawn = [
        ContestLaunch(None, [1, 2], [[round(each) for each in row] for row in 1e6 * rows])
        for rows in noisy.uniform(1, 2, size=(9, 8, 2))
    ]
    assert remaining(drawn, [[0, 1, 2]]) == [1, 2]


@pytest.mark.parametrize(
    ("error", "status", "detail"),
    [
        (OutOfTimeError("long"), Status.OK, "too long for 40 s"),
        (MachineError("it crashed"), Status.FAILED, "it crashed"),
        (KeyboardInterrupt(), Status.INTERRUPTED, "interrupted"),
    ],
)
def test_what_ends_a_contest_is_recorded(
    monkeypatch: pytest.MonkeyPatch, error: BaseException, status: Status, detail: str
) -> None:
    def fail(*arguments: object) -> None:
        raise error

    monkeypatch.setattr(contest.preparation, "prepare", fail)
    with WorkerPool() as pool:
        groups = [[Variant("python_loop", {}), Variant("python_loop_hold", {})]]
        record = contest.run(pool, SOURCE, ComparisonPlan(()), groups, SIZES)
    assert record.status == status
    assert detail in record.detail
    assert record.launches == []


class _SlowLaunches:
    """Launches of which each takes ten seconds."""

    now_s = 0.0

    def __init__(self, *arguments: object) -> None:
        self.limit = arguments[-1]
        assert isinstance(self.limit, contest.TimeLimit)
        self.limit.start()

    def __enter__(self) -> "_SlowLaunches":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        pass

    def launch(self, positions: Sequence[int]) -> ContestLaunch:
        _SlowLaunches.now_s += 10.0
        ns = [[random.randrange(1_000, 2_000) for _ in positions] for _ in range(2)]
        return ContestLaunch(None, list(positions), ns)


def test_no_launch_begins_that_would_exceed_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contest, "_Processes", _SlowLaunches)
    groups = [[Variant("python_loop", {}), Variant("python_loop_hold", {})]]
    with WorkerPool() as pool:
        record = contest.run(
            pool, SOURCE, ComparisonPlan(()), groups, SIZES, clock=lambda: _SlowLaunches.now_s
        )
    assert len(record.launches) == 4
    assert record.detail == "only 4 of 8 launches fit into 40 s"
