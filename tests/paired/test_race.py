"""Which path is the fastest: the rule, on synthetic launches with a known truth."""

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from example_races import race

from mjbench.errors import MachineError
from mjbench.paired import race_record
from mjbench.paired.launches import Targets, UnableError
from mjbench.paired.race import (
    LONG_NS,
    LONG_ROUNDS,
    ROUNDS,
    RaceBudget,
    remaining,
    time_launch,
    time_rounds,
)
from mjbench.paired.race_record import (
    FINAL_LAUNCHES,
    MIN_FINAL_LAUNCHES,
    Loop,
    RaceLaunch,
    RaceRecord,
    Standing,
    UnableVariant,
)
from mjbench.status import Status
from mjbench.verification.plan import Variant

BASE_NS = 10_000_000


@dataclass
class Track(Targets[RaceLaunch]):
    """Launches variants whose speeds are known; each launch takes a fifth of a second and
    as much for each variant.

    Attributes:
      speeds: of the variants, over the plain loop, which is the first.
      spread: standard deviation of the logarithm of a variant's time in a launch.
      before: called before each launch with its number; it may raise.
      short: numbers of launches in which threads have too few cores.
    """

    speeds: Sequence[float]
    spread: float = 0.01
    before: Callable[[int, Sequence[int]], None] = lambda number, positions: None
    short: Collection[int] = ()
    now_s: float = 0.0
    launched: list[list[int]] = field(default_factory=list)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def clock(self) -> float:
        return self.now_s

    def launch(self, positions: Sequence[int]) -> RaceLaunch:
        self.before(len(self.launched), positions)
        self.now_s += 0.2 + 0.2 * len(positions)
        self.launched.append(list(positions))
        noise = np.exp(self.rng.normal(0, self.spread, len(self.speeds)))
        ns = [round(BASE_NS / self.speeds[i] * noise[i]) for i in positions]
        lacked_cores = len(self.launched) in self.short
        return RaceLaunch(None, list(positions), [ns, ns], lacked_cores=lacked_cores)

    def run(self, record: RaceRecord, budget_s: float = 60.0) -> list[RaceRecord]:
        return race(record, self, RaceBudget(budget_s, self.clock))


def entered(count: int, **fields: object) -> RaceRecord:
    values: dict[str, object] = {
        "model": "m",
        "steps": 1000,
        "variants": [Variant(f"path{i}", {}) for i in range(count)],
        "groups": [list(range(count))] * 2,
        **fields,
    }
    return RaceRecord(**values)  # type: ignore[arg-type]


def ended(record: RaceRecord) -> Standing:
    """Return what a race said of paths for open loop."""
    return record.standings[Loop.OPEN]


def test_the_fastest_wins_and_is_launched_again_beside_the_plain_loop() -> None:
    track = Track([1.0, 1.1, 1.5, 2.0])
    record = track.run(entered(4))[-1]
    standing = ended(record)
    assert (standing.fastest, standing.chosen) == (3, 3)
    assert standing.is_decided
    assert not record.is_cut_short
    assert track.launched[0] == [0, 1, 2, 3]
    assert not record.launches[0].is_final
    assert [0, 3] in track.launched


def test_the_figures_of_winners_and_the_plain_loop_are_of_launches_after_the_race() -> None:
    track = Track([1.0, 1.2, 2.0])
    record = track.run(entered(3))[-1]
    finals = [launch for launch in record.launches if launch.is_final]
    assert len(finals) == FINAL_LAUNCHES
    assert all(list(launch.variants) == [0, 2] for launch in finals)
    assert record.launch_count(record.variants[2]) == FINAL_LAUNCHES
    assert record.launch_count(record.variants[1]) < len(record.launches)
    speedup = record.speedup(record.variants[2])
    assert speedup.covers(2.0)
    assert speedup.estimate == pytest.approx(2.0, rel=0.02)


def test_of_paths_that_are_as_good_the_simplest_is_chosen() -> None:
    standing = ended(Track([1.0, 2.0, 2.002], spread=0.003).run(entered(3))[-1])
    assert standing.chosen == 1


def test_a_race_that_has_no_time_is_cut_short_and_says_so() -> None:
    record = Track([1.0, 1.001, 1.002], spread=0.2).run(entered(3), budget_s=4.0)[-1]
    standing = ended(record)
    assert record.is_cut_short
    assert not standing.is_decided
    assert standing.most_gain > 0.02


def test_a_race_without_time_for_all_goes_on_with_the_faster_half_of_those_it_timed_last() -> None:
    track = Track([1.0, *np.linspace(1.5, 2.0, 12)], spread=0.3)
    record = track.run(entered(13), budget_s=14.0)[-1]
    narrow = [set(launch.variants) - {0} for launch in record.launches if launch.is_narrow]
    assert len(narrow) >= 2
    for earlier, later in itertools.pairwise([set(range(13)), *narrow]):
        assert later <= earlier
        assert len(later) <= (len(earlier) + 1) // 2 + 1
    standing = ended(record)
    assert record.is_cut_short
    assert standing.fastest in narrow[-1]
    assert set(standing.contenders) > narrow[-1], "those that were left out are not out"
    assert sum(launch.is_final for launch in record.launches) >= MIN_FINAL_LAUNCHES


def test_the_budget_bounds_the_launches_after_the_race_too() -> None:
    track = Track([1.0, 1.001, 1.002, 1.003], spread=0.1)
    record = track.run(entered(4), budget_s=20.0)[-1]
    assert track.now_s <= 20.0
    assert sum(each.is_final for each in record.launches) >= MIN_FINAL_LAUNCHES


def test_one_launch_is_made_whatever_the_budget() -> None:
    track = Track([1.0, 2.0])
    record = track.run(entered(2), budget_s=0.5)[-1]
    assert len(record.launches) == 1
    assert record.is_cut_short
    speedup = record.speedup(record.variants[1])
    assert (speedup.low, speedup.high) == (None, None)


def test_a_variant_in_no_group_is_in_every_launch_and_never_wins() -> None:
    track = Track([1.0, 3.0, 2.0])
    record = track.run(entered(3, groups=[[0, 2], [0]]))[-1]
    assert all(1 in positions for positions in track.launched)
    standing = ended(record)
    assert standing.chosen == 2


def test_a_slow_variant_is_timed_last_beside_the_plain_loop() -> None:
    track = Track([1.0, 2.0, 1.5])
    record = track.run(entered(3, groups=[[0, 1], [0]], slow=[2]))[-1]
    last = track.launched[-MIN_FINAL_LAUNCHES:]
    assert last == [[0, 2]] * MIN_FINAL_LAUNCHES
    assert all(each.is_final for each in record.launches[-MIN_FINAL_LAUNCHES:])
    speedup = record.speedup(record.variants[2])
    assert speedup.estimate == pytest.approx(1.5, rel=0.05)


def test_launches_of_slow_variants_give_no_figures_of_others() -> None:
    track = Track([1.0, 2.0, 1.5], spread=0.0)

    def before(number: int, positions: Sequence[int]) -> None:
        track.speeds = [0.5 if 2 in positions else 1.0, 2.0, 1.5]

    track.before = before
    record = track.run(entered(3, groups=[[0, 1], [0]], slow=[2]), budget_s=0.5)[-1]
    assert [each.is_final for each in record.launches] == [False] + [True] * MIN_FINAL_LAUNCHES
    assert record.base_step_ns == pytest.approx(BASE_NS / 1000)
    figures = [record.has_final_figures(variant) for variant in record.variants]
    assert figures == [False, False, True]
    assert record.launch_count(record.variants[0]) == 1


def test_the_plain_loop_is_not_launched_alone_because_slow_variants_failed() -> None:
    def before(number: int, positions: Sequence[int]) -> None:
        if 2 in positions:
            raise UnableError(2, Status.FAILED, "no cluster")

    track = Track([1.0, 2.0, 1.5], before=before)
    record = track.run(entered(3, groups=[[0, 1], [0]], slow=[2]))[-1]
    assert [each.variant for each in record.unable] == [2]
    assert [0] not in track.launched


def test_a_race_without_its_plain_loop_ends() -> None:
    def before(number: int, positions: Sequence[int]) -> None:
        raise UnableError(0, Status.CRASHED, "killed by SIGSEGV")

    record = Track([1.0, 2.0], before=before).run(entered(2))[-1]
    assert (record.status, record.detail) == (Status.CRASHED, "killed by SIGSEGV")
    assert record.launches == ()
    assert record.standings == {}


@pytest.mark.parametrize(
    ("error", "status"),
    [(MachineError("it crashed"), Status.FAILED), (KeyboardInterrupt(), Status.INTERRUPTED)],
)
def test_what_was_measured_before_a_failure_is_kept(error: BaseException, status: Status) -> None:
    def before(number: int, positions: Sequence[int]) -> None:
        if number == 2:
            raise error

    record = Track([1.0, 2.0], before=before).run(entered(2))[-1]
    assert (record.status, len(record.launches)) == (status, 2)
    assert record.is_cut_short


@pytest.mark.parametrize("seed", range(5))
def test_a_path_that_is_fast_in_its_first_launch_alone_is_not_advised(seed: int) -> None:
    track = Track([1.0, 1.0, 1.5], rng=np.random.default_rng(seed))

    def before(number: int, positions: Sequence[int]) -> None:
        track.speeds = [1.0, 3.0 if number == 0 else 0.9, 1.5]

    track.before = before
    record = track.run(entered(3))[-1]
    assert ended(record).chosen == 2
    speedup = record.speedup(record.variants[1])
    assert speedup.low is None or speedup.low <= 0.9


@pytest.mark.parametrize("is_simpler", [True, False])
@pytest.mark.parametrize("slow_one", range(3))
def test_a_path_that_is_slower_by_3_percent_in_every_third_launch_is_not_the_fastest(
    is_simpler: bool, slow_one: int
) -> None:
    saboteur, honest = (1, 2) if is_simpler else (2, 1)
    track = Track([1.0, 2.0, 2.0, 1.5], spread=0.005)

    def before(number: int, positions: Sequence[int]) -> None:
        speeds = [1.0, 2.0, 2.0, 1.5]
        speeds[saboteur] /= 1.03 if number % 3 == slow_one else 1.0
        track.speeds = speeds

    track.before = before
    record = track.run(entered(4))[-1]
    assert ended(record).chosen == honest
    speedup = record.speedup(record.variants[saboteur])
    assert speedup.covers(2.0 / 1.01)


@pytest.mark.parametrize("launches", range(14))
def test_a_path_that_computes_something_else_in_any_launch_is_never_advised(launches: int) -> None:
    """From then on: it would have won, in the race or after it."""
    track = Track([1.0, 2.0, 1.8, 1.2])

    def before(number: int, positions: Sequence[int]) -> None:
        if number >= launches and 1 in positions:
            raise UnableError(1, Status.DISAGREES, "in a timed block: qpos[0]")

    track.before = before
    *_, record = track.run(entered(4))
    standing = ended(record)
    if not record.unable:
        assert len(track.launched) <= launches, "it was not launched any more"
        return
    assert (standing.chosen, 1 in standing.contenders) == (2, False)
    assert standing.is_decided
    assert not record.is_cut_short
    assert record.has_final_figures(record.variants[2])
    speedup = record.speedup(record.variants[2])
    assert speedup.covers(1.8)


def test_the_next_best_is_known_where_there_is_no_time_to_reopen_the_race() -> None:
    record = Track([1.0, 2.0, 1.8, 1.2]).run(entered(4))[-1]
    failed = replace(record, unable=[UnableVariant(1, Status.CRASHED, "killed by SIGSEGV")])
    assert ended(record).chosen == 1
    assert ended(failed).chosen == 2
    assert not failed.has_final_figures(failed.variants[2])


def test_a_simpler_path_that_is_certainly_slower_leaves_by_however_little() -> None:
    track = Track([1.0, 1.99, 2.0], spread=0.0005)
    record = entered(3, launches=[track.launch(range(3)) for _ in range(12)])
    standing = ended(record)
    assert (standing.chosen, standing.contenders) == (2, [2])
    assert remaining(record) == [0, 2]


def test_a_path_that_is_entered_twice_is_never_faster_than_itself() -> None:
    for seed in range(30):
        track = Track([1.0, 2.0, 2.0, 1.2], rng=np.random.default_rng(seed))
        record = track.run(entered(4), budget_s=25.0)[-1]
        ratio = record.ratio(record.variants[1], record.variants[2])
        assert ratio.covers(1.0)
        standing = ended(record)
        assert {1, 2} <= set(standing.contenders)


def test_the_fastest_is_hardly_ever_dropped() -> None:
    dropped = 0
    rng = np.random.default_rng(1)
    for _ in range(40):
        speeds = [1.0, *np.exp(rng.normal(0.3, 0.1, 7))]
        track = Track(speeds, spread=0.03, rng=rng)
        standing = ended(track.run(entered(8), budget_s=25.0)[-1])
        dropped += int(np.argmax(speeds)) not in standing.contenders
    assert dropped <= 40 * race_record.ERROR


def test_intervals_hold_for_paths_that_left_and_for_winners() -> None:
    covered: list[bool] = []
    rng = np.random.default_rng(2)
    for _ in range(40):
        speeds = [1.0, *np.exp(rng.normal(0.2, 0.15, 5))]
        record = Track(speeds, spread=0.02, rng=rng).run(entered(6), budget_s=25.0)[-1]
        for variant, speed in zip(record.variants[1:], speeds[1:], strict=True):
            speedup = record.speedup(variant)
            covered.append(speedup.covers(speed))
    assert np.mean(covered) >= 0.93


def test_a_disturbed_launch_of_the_race_does_not_move_a_speed_up() -> None:
    track = Track([1.0, 2.0], spread=0.005)

    def before(number: int, positions: Sequence[int]) -> None:
        track.speeds = [1.0, 1.0 if number == 1 else 2.0]

    track.before = before
    record = track.run(entered(2))[-1]
    speedup = record.speedup(record.variants[1])
    assert speedup.estimate == pytest.approx(2.0, rel=0.01)


def test_rounds_in_both_orders_weigh_the_same() -> None:
    ns = [[100, 220], [110, 200]]  # the second block of a round is slower by a tenth
    assert RaceLaunch(None, [0, 1], ns).log_ratio(0, 1) == pytest.approx(np.log(2.0))


@pytest.mark.parametrize("ns", [[], [[1, 2]], [[1], [2]]])
def test_a_launch_has_all_its_blocks(ns: list[list[int]]) -> None:
    with pytest.raises(ValueError, match="ns has a row"):
        RaceLaunch(None, [0, 1], ns)


def test_a_record_names_variants_that_it_has() -> None:
    with pytest.raises(ValueError, match="names a later one"):
        entered(2, groups=[[0, 2], [0]])
    with pytest.raises(ValueError, match="names a later one"):
        entered(2, slow=[2])
    with pytest.raises(ValueError, match="not one for each loop"):
        entered(2, groups=[[0, 1]])
    with pytest.raises(ValueError, match="lacks the plain loop"):
        entered(2, launches=[RaceLaunch(None, [1], [[1], [1]])])


@pytest.mark.parametrize(
    ("block_ns", "rounds"), [(1_000_000, ROUNDS), (LONG_NS // 6 + 1, LONG_ROUNDS)]
)
def test_long_blocks_have_fewer_rounds_in_both_orders(block_ns: int, rounds: int) -> None:
    orders: list[Sequence[int]] = []

    def time_round(order: Sequence[int]) -> list[int]:
        orders.append(order)
        return [block_ns] * 3

    assert time_rounds(time_round, 3) == [[block_ns] * 3] * rounds
    assert len(orders) == rounds
    assert orders[1] == orders[0][::-1]


@pytest.mark.parametrize(("other_s", "rounds"), [(0.0, 4), (0.2, 4), (0.5, 8)])
def test_a_busy_launch_has_twice_the_rounds(other_s: float, rounds: int) -> None:
    rows, other_cores = time_launch(
        lambda order: [1] * len(order),
        3,
        iter([5.0, 5.0 + other_s]).__next__,
        iter([7.0, 8.0]).__next__,
    )
    assert len(rows) == rounds
    assert other_cores == pytest.approx(other_s)


@pytest.mark.parametrize(("other_cores", "ratio"), [(0.1, 0.5**0.5), (0.5, 0.5)])
def test_the_faster_half_counts_and_the_fastest_in_a_busy_launch(
    other_cores: float, ratio: float
) -> None:
    ns = [[200, 100], [200, 200], [200, 900], [200, 300]]
    launch = RaceLaunch(None, [0, 1], ns, other_cores)
    assert launch.log_ratio(0, 1) == pytest.approx(np.log(ratio))


def test_the_speedup_of_a_busy_race_is_of_the_launches_that_were_disturbed_least() -> None:
    speedups = [2.0, 2.1, 1.9, 1.0, 0.9]
    launches = [
        RaceLaunch(None, [0, 1], [[BASE_NS, round(BASE_NS / each)]] * 2, other_cores=0.5)
        for each in speedups
    ]
    speedup = replace(entered(2), launches=launches).speedups[1]
    assert speedup is not None
    assert speedup.estimate == pytest.approx((2.0 * 2.1 * 1.9) ** (1 / 3))
    assert (speedup.low, speedup.high) == pytest.approx((0.9, 2.1))


def test_launches_whose_threads_had_too_few_cores_do_not_count_beside_enough_others() -> None:
    def launch(speed: float, *, lacked_cores: bool = False) -> RaceLaunch:
        ns = [[BASE_NS, round(BASE_NS / speed)]] * 2
        return RaceLaunch(2.0, [0, 1], ns, lacked_cores=lacked_cores)

    short = [launch(0.7, lacked_cores=True) for _ in range(6)]
    few = replace(entered(2), launches=[*short, *map(launch, [2.0, 2.01])])
    assert ended(few).fastest == 0
    enough = replace(few, launches=[*few.launches, launch(1.99)])
    assert ended(enough).fastest == 1
    speedup = enough.speedups[1]
    assert speedup is not None
    assert speedup.estimate == pytest.approx(2.0, rel=0.01)
    assert enough.launch_count(enough.variants[1]) == 3


def test_short_launches_after_a_race_are_made_again() -> None:
    record = Track([1.0, 2.0], spread=0.005, short={6, 7, 9}).run(entered(2))[-1]
    final = [each.lacked_cores for each in record.launches if each.is_final]
    assert (final.count(False), final.count(True)) == (FINAL_LAUNCHES, 3)


def test_of_busy_launches_the_fastest_block_says_which_path_leads() -> None:
    def launch(first_ns: int, second_ns: int) -> RaceLaunch:
        return RaceLaunch(None, [0, 1, 2], [[BASE_NS, first_ns, second_ns]] * 2, other_cores=0.5)

    launches = [launch(8, 5), launch(8, 20), launch(8, 20)]
    assert ended(replace(entered(3), launches=launches)).fastest == 2
    quiet = [replace(each, other_cores=0.0) for each in launches]
    assert ended(replace(entered(3), launches=quiet)).fastest == 1
