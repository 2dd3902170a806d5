"""What a race of `mjbench compare` stores, and what follows from its launches; pure functions.

A launch is a fresh process in which every path that is still in the race is timed beside the plain
loop (see `race`). All that is shown is computed here, so it can be computed again from a run file.
"""

import functools
import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import ClassVar

import numpy as np

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt
from mjbench.host.disturbance import Disturbance
from mjbench.interval import Interval
from mjbench.measuring import launch_stats, stats
from mjbench.paths.base import nthread
from mjbench.simulation import engine_clock
from mjbench.status import Status
from mjbench.verification.plan import WITHOUT_TIMER, Variant

# A race is decided where no path can be faster than the fastest by more than this: nobody would do
# much better by waiting.
MARGIN = 0.05
# A simpler path that is slower than the fastest by less than this is as good.
AS_GOOD = 0.02
# Probability that a race drops a path which is the fastest, over all looks and pairs of paths.
ERROR = 0.05
# Of the interval of a speed-up.
CONFIDENCE = 0.95
_LOG_MARGIN, _LOG_AS_GOOD = float(np.log1p(MARGIN)), float(np.log1p(AS_GOOD))
# Launches of a race at least, because fewer decide nothing, and at most.
MIN_LAUNCHES, MAX_LAUNCHES = 3, 100
# Launches after a race; fewer give no figures of their own; and at most.
MIN_FINAL_LAUNCHES, FINAL_LAUNCHES = 4, 8
# A launch is busy where other programs use this number of cores, which reads 0.1 at most where none
# runs.
BUSY_CORES = 0.25


class Loop(StrEnum):
    """Where controls come from."""

    OPEN = "open"
    """They are known before the run."""
    CLOSED = "closed"
    """A policy chooses each from the state before it."""


@dataclass(frozen=True)
class RaceLaunch:
    """One fresh process that timed some variants.

    Attributes:
      cores: how many cores threads got in it; None where no variant has threads.
      variants: which of the race's were timed, by their position; the plain loop is the first.
      ns: (rounds, variants) nanoseconds of blocks. Every second round runs in the opposite order of
        the one before.
      other_cores: how many cores other programs used in the first rounds.
      lacked_cores: whether threads had too few cores in it. Where it is not busy, the host of a
        virtual machine gave them to others.
      is_narrow: whether it timed only the contenders that lead, for lack of time.
      is_final: whether it came after the race.
    """

    cores: PositiveFloat | None
    variants: Sequence[NonNegativeInt]
    ns: Sequence[Sequence[PositiveInt]]
    other_cores: NonNegativeFloat = 0.0
    lacked_cores: bool = False
    is_narrow: bool = False
    is_final: bool = False

    def __post_init__(self) -> None:
        if len(self.ns) % 2 or not self.ns or any(len(r) != len(self.variants) for r in self.ns):
            raise ValueError("ns has a row for each round, as many each way, of all its variants")

    @property
    def is_busy(self) -> bool:
        """Whether other programs used the cores."""
        return self.other_cores >= BUSY_CORES

    def log_ratio(self, baseline: int, candidate: int) -> float:
        """Return the natural logarithm of one variant's time over another's."""
        return self._log_ns[candidate] - self._log_ns[baseline]

    def block_ns(self, variant: int) -> float:
        return math.exp(self._log_ns[variant])

    @functools.cached_property
    def _log_ns(self) -> dict[int, float]:
        """The mean of the logarithms of the faster half of each variant's blocks.

        Whatever disturbs a block makes it slower. In a busy launch most blocks are disturbed, above
        all those of threads: the fastest counts.
        """
        ordered = np.sort(stats.logarithms(self.ns), axis=0)
        logs = ordered[: 1 if self.is_busy else len(ordered) // 2].mean(axis=0)
        return dict(zip(self.variants, logs.tolist(), strict=True))


@dataclass(frozen=True)
class UnableVariant:
    """A variant that left a race because it cannot go on.

    Attributes:
      variant: which of the race's, by its position.
      status: why, such as `disagrees`.
      detail: why, in one line.
    """

    variant: NonNegativeInt
    status: Status
    detail: str


@dataclass(frozen=True)
class Standing:
    """What a race says of the paths that compete with each other, by their positions.

    Attributes:
      chosen: the simplest contender that is as good as the fastest: within `AS_GOOD` certainly, and
        within half of it by estimate.
      contenders: all that are not certainly slower than the fastest, itself included.
      leaders: those of them that the last launch timed, the fastest by estimate first.
      most_gain: share by which a contender may be faster than the fastest, at most; infinity where
        launches are too few to say. Twins of the fastest (see `Variant.is_twin_of`) that are within
        `AS_GOOD` of it by estimate do not count: they are the same advice.
    """

    fastest: int
    chosen: int
    contenders: Sequence[int]
    leaders: Sequence[int]
    most_gain: float

    @property
    def is_decided(self) -> bool:
        """Whether no contender can be faster than the fastest by `MARGIN`."""
        return self.most_gain <= MARGIN


@dataclass(frozen=True, kw_only=True)
class RaceRecord:
    """A race of the variants on one model, and what was measured after it.

    Attributes:
      nbatch_asked: simulations that the user asked for; None where mjbench chose.
      steps: of one block, all simulations together.
      variants: what was timed, the plain loop first.
      groups: variants that compete with each other, by their positions, each from the simplest on:
        for open loop, and for closed loop. One that is in no group is timed in every launch, unless
        it is slow.
      slow: variants that take long to start, by their positions; they are timed last, beside the
        plain loop.
      unable: those that could not go on.
      is_cut_short: whether the race ended before it was decided, or before there were
        `MIN_FINAL_LAUNCHES` after it: its budget was used, or something ended it.
    """

    record_type: ClassVar[str] = "race"
    model: str
    nbatch_asked: PositiveInt | None = None
    steps: PositiveInt
    variants: Sequence[Variant]
    groups: Sequence[Sequence[NonNegativeInt]]
    slow: Sequence[NonNegativeInt] = ()
    unable: Sequence[UnableVariant] = ()
    status: Status = Status.OK
    detail: str = ""
    is_cut_short: bool = False
    launches: Sequence[RaceLaunch] = ()
    disturbance: Disturbance = field(default_factory=Disturbance)

    def __post_init__(self) -> None:
        positions = {each.variant for each in self.unable}.union(self.slow, *self.groups)
        positions.update(*(launch.variants for launch in self.launches))
        if any(position >= len(self.variants) for position in positions):
            raise ValueError(f"it has {len(self.variants)} variants, and names a later one")
        if len(self.groups) != len(Loop):
            raise ValueError(f"it has {len(self.groups)} groups, and not one for each loop")
        if any(0 not in launch.variants for launch in self.launches):
            raise ValueError("a launch lacks the plain loop, which is the first variant")

    @property
    def able(self) -> set[int]:
        return set(range(len(self.variants))) - {each.variant for each in self.unable}

    @property
    def other_cores(self) -> float:
        """How many cores other programs used, in the median launch; 0 without any."""
        return _median_other_cores(self.launches)

    @property
    def is_busy(self) -> bool:
        """Whether most launches are."""
        return self.other_cores >= BUSY_CORES

    def threads(self, launch: RaceLaunch) -> list[int]:
        return [nthread(self.variants[i].options) for i in launch.variants]

    @property
    def is_decided(self) -> bool:
        """Whether the race has said of both loops which paths are as good as the fastest."""
        is_certain = all(each.is_decided for each in self.standings.values())
        return is_certain and len(self._race_launches) >= MIN_LAUNCHES

    @property
    def base_step_ns(self) -> float | None:
        """Nanoseconds of a step of the plain loop: the median over launches; None without any."""
        launches = self._launches_of(0)
        if not launches:
            return None
        return statistics.median(each.block_ns(0) for each in launches) / self.steps

    def winner(self, standing: Standing) -> int:
        """Return the chosen variant of a loop, or the other loop's where that is better after all.

        Winners of both loops are timed after the race. Where the race was not decided, that of the
        other loop takes the place of this one's if it is a contender, and its figure is better by
        more than `AS_GOOD`.
        """

        def speedup(position: int) -> float:
            ratio = self.speedups[position]
            return 0.0 if ratio is None else ratio.estimate

        if standing.is_decided:
            return standing.chosen
        winners = {each.chosen for each in self.standings.values()}
        least = (1 + AS_GOOD) * speedup(standing.chosen)
        better = [i for i in winners.intersection(standing.contenders) if speedup(i) > least]
        return max(better, key=speedup, default=standing.chosen)

    def advised(self, standing: Standing) -> int:
        """Return the winner; the plain loop where that one is not even likely to be faster."""
        winner = self.winner(standing)
        speedup = self.speedups[winner]
        if speedup is None or not (speedup.is_above(1.0) or speedup.estimate > 1 + AS_GOOD):
            return 0
        return winner

    def speedup(self, variant: Variant) -> Interval | None:
        """Return the speed-up of a variant over the plain loop; None where it was not timed.

        It is from the launches after the race where there are enough of the variant, else from all
        that timed it. The interval may be computed after any launch (see `launch_stats`).
        """
        position = self._position(variant)
        return None if position is None else self.speedups[position]

    @property
    def timer_gain(self) -> Interval | None:
        """What turning MuJoCo's timer off gains, where that is certain and worth a line."""
        gain = self.speedup(WITHOUT_TIMER)
        if gain is None or not gain.is_above(1.0) or gain.estimate < 1 + engine_clock.MIN_GAIN:
            return None
        return gain

    def ratio(self, faster: Variant, slower: Variant) -> Interval | None:
        """Return how many times faster one variant is than another; None where none timed both."""
        first, second = self._position(faster), self._position(slower)
        if first is None or second is None:
            return None
        return self.ratio_of(first, second)

    def ratio_of(self, first: int, second: int) -> Interval | None:
        both = [each for each in self.launches if {first, second} <= set(each.variants)]
        return self._interval(undisturbed(both), first, second) if both else None

    def step_s(self, variant: Variant) -> list[float]:
        position = self._position(variant)
        if position is None:
            return []
        launches = self._launches_of(position)
        return [1e-9 * launch.block_ns(position) / self.steps for launch in launches]

    def launch_count(self, variant: Variant) -> int:
        return len(self._launches_of(self._position(variant)))

    def has_final_figures(self, variant: Variant) -> bool:
        """Return whether the speed-up of a variant is from launches after the race alone."""
        launches = self._launches_of(self._position(variant))
        return bool(launches) and all(launch.is_final for launch in launches)

    @functools.cached_property
    def standings(self) -> Mapping[Loop, Standing]:
        """What the race says of each loop; nothing without a launch.

        Variants that the last launch which was not narrow did not time are out. Where one of that
        launch has failed since, those that left because of it are in again.
        """
        race = self._race_launches
        if not race:
            return {}
        timed = set(next(each for each in reversed(race) if not each.is_narrow).variants)
        if not timed <= self.able:
            timed.update(*(launch.variants for launch in race))
        left = timed & self.able
        groups = ([i for i in group if i in left] for group in self.groups)
        return {
            loop: standing_of(race, group, self.variants)
            for loop, group in zip(Loop, groups, strict=True)
            if group
        }

    @functools.cached_property
    def speedups(self) -> list[Interval | None]:
        """The speed-up of each variant over the plain loop; None where it was not timed."""
        return [self._speedup(position) for position in range(len(self.variants))]

    def _speedup(self, position: int) -> Interval | None:
        launches = self._launches_of(position)
        if not launches:
            return None
        if position == 0:
            return Interval(1.0, 1.0, 1.0)
        if self.is_busy:
            logs = [launch.log_ratio(position, 0) for launch in launches]
            return launch_stats.least_disturbed(logs, MIN_LAUNCHES).exponential
        # a ratio of speeds is that of times the other way round
        return self._interval(launches, baseline=position, candidate=0)

    @property
    def _race_launches(self) -> list[RaceLaunch]:
        return undisturbed([launch for launch in self.launches if not launch.is_final])

    def _position(self, variant: Variant) -> int | None:
        return next((i for i, each in enumerate(self.variants) if each == variant), None)

    def _launches_of(self, position: int | None) -> list[RaceLaunch]:
        """Return the launches that give a variant's figures: of a busy race, all that timed it.

        Launches of slow variants follow the race, but are not of its winners: they give figures of
        the slow ones, and of others only where there are none else.
        """
        timed = [launch for launch in self.launches if position in launch.variants]
        if position not in self.slow:
            slow = set(self.slow)
            timed = [each for each in timed if slow.isdisjoint(each.variants)] or timed
        timed = undisturbed(timed)
        final = [launch for launch in timed if launch.is_final]
        return final if len(final) >= MIN_FINAL_LAUNCHES and not self.is_busy else timed

    def _interval(self, launches: Sequence[RaceLaunch], baseline: int, candidate: int) -> Interval:
        """Return the ratio of two variants' times, the candidate's over the baseline's.

        How many launches there are after a race does not depend on what they say, so theirs has
        Student's interval, with the spread of those of the race where that is larger. The interval
        of launches of the race may be computed after any of them.
        """
        if not all(launch.is_final for launch in launches):
            mean, half_width = log_ratio(launches, baseline, candidate)
            return Interval.around(mean, half_width(CONFIDENCE)).exponential
        both = [each for each in self._race_launches if {baseline, candidate} <= set(each.variants)]
        final, race = (
            [each.log_ratio(baseline, candidate) for each in group] for group in (launches, both)
        )
        return launch_stats.student_interval(final, CONFIDENCE, beside=race).exponential


def undisturbed(launches: Sequence[RaceLaunch]) -> list[RaceLaunch]:
    """Return the launches without those that the host took cores from; all if they are too few."""
    rest = [launch for launch in launches if launch.is_busy or not launch.lacked_cores]
    is_enough = sum(not launch.is_narrow for launch in rest) >= MIN_LAUNCHES
    return rest if is_enough else list(launches)


def _median_other_cores(launches: Sequence[RaceLaunch]) -> float:
    return statistics.median([launch.other_cores for launch in launches] or [0.0])


def standing_of(
    launches: Sequence[RaceLaunch], group: Sequence[int], variants: Sequence[Variant]
) -> Standing:
    """Return what the launches of a race say of variants that compete with each other.

    A variant is out once it is certainly slower than the fastest. The error of that is spent over
    all ordered pairs of entrants, because which is the fastest follows from the same launches. By
    how much a contender may be faster is a one-sided bound, whose error is spent over the rivals
    of the fastest. The intervals may be looked at after every launch (see `launch_stats`).

    Args:
      launches: of the race; the first timed all of the group.
      group: the positions of variants that are not out, from the simplest on. The fastest is one
        of those that the last launch timed.
    """
    entrants = len(variants)
    out_confidence = 1 - ERROR / max(1, entrants * (entrants - 1))
    # one side for each rival of the fastest, because none of them is to be faster
    gain_confidence = 1 - 2 * ERROR / max(2, len(group) - 1)
    last = [i for i in group if i in launches[-1].variants] or group
    shared = [launch for launch in launches if set(last) <= set(launch.variants)]
    # the median, because a few launches cannot say which of them were disturbed; of busy ones, most
    # were
    is_busy = _median_other_cores(shared) >= BUSY_CORES
    times = {
        i: min(each.block_ns(i) for each in shared)
        if is_busy
        else statistics.median(each.log_ratio(0, i) for each in shared)
        for i in last
    }
    fastest = min(last, key=lambda i: times[i])
    chosen, contenders, most_gain = fastest, [fastest], 0.0
    for i in reversed(group):
        if i == fastest:
            continue
        mean, half_width_at = log_ratio(launches, fastest, i)
        if mean - half_width_at(out_confidence) > 0:
            continue
        contenders.append(i)
        half_width = half_width_at(gain_confidence)
        if not (variants[i].is_twin_of(variants[fastest]) and mean < _LOG_AS_GOOD):
            most_gain = max(most_gain, float(np.expm1(half_width - mean)))
        is_simpler = group.index(i) < group.index(fastest)
        if is_simpler and mean <= _LOG_AS_GOOD / 2 and mean + half_width <= _LOG_AS_GOOD:
            chosen = i
    leaders = sorted(set(contenders).intersection(last), key=lambda i: times[i])
    return Standing(fastest, chosen, sorted(contenders), leaders, most_gain)


def log_ratio(
    launches: Sequence[RaceLaunch], baseline: int, candidate: int
) -> tuple[float, Callable[[float], float]]:
    """Return the log ratio of two variants' times, and half its interval's width by confidence.

    The spread of launches is pooled over all variants that those launches timed, unless that of the
    two is larger: so three launches of many variants have an interval, and a variant whose times
    scatter has a wide one. Disturbed launches are left out of the mean (see `launch_stats.fit`).
    """
    both = [each for each in launches if {baseline, candidate} <= set(each.variants)]
    ratios = np.array([each.log_ratio(baseline, candidate) for each in both])
    fitted = launch_stats.fit(ratios[None, None, :])
    variants = sorted(set.intersection(*(set(each.variants) for each in both)))
    pooled, freedom = _pooled_variance(both, variants)
    own_freedom = int(fitted.freedom[0])
    variance = max(2 * pooled, float(fitted.squares[0]) / max(1, own_freedom))
    freedom = max(freedom, own_freedom)
    spread = replace(fitted, freedom=np.array([freedom]), squares=np.array([freedom * variance]))
    return float(fitted.mean[0]), lambda confidence: float(spread.half_width(confidence)[0])


def _pooled_variance(launches: Sequence[RaceLaunch], variants: Sequence[int]) -> tuple[float, int]:
    """Return the variance of one variant's log time in a launch, and its degrees of freedom.

    It is that of the residuals of launch × variant, without the means of each.
    """
    logs = np.array([[each.log_ratio(0, i) for i in variants] for each in launches])
    residuals = logs - logs.mean(axis=0) - logs.mean(axis=1, keepdims=True) + logs.mean()
    freedom = (len(launches) - 1) * (len(variants) - 1)
    return float((residuals**2).sum()) / max(1, freedom), freedom
