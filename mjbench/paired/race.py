"""Which way of stepping is the fastest: a race of paths over launches.

A launch is a fresh process in which every path that is still in the race is timed beside the plain
loop. Paths leave once they are certainly slower than the fastest of their loop. The race ends when
no path that is left can be faster than the fastest by `MARGIN`. The winner of a race is flattered
by it, so launches after the race give the figures of the paths that won, and of the plain loop.
Where a winner fails in one of these, the race goes on with those that left because of it.
`race` runs it; `race_record` says what follows from its launches.
"""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench.paired.launches import StopRule, Targets, UnableError, launch
from mjbench.paired.race_record import MIN_FINAL_LAUNCHES, RaceLaunch, RaceRecord, UnableVariant
from mjbench.status import Status

# Launches in all at most before the race is over, and after it.
MAX_LAUNCHES, FINAL_LAUNCHES = 100, 8
# A launch of a few paths takes at least this share of the time of one of all: it starts a process.
_SHARE_OF_START = 0.25


@dataclass(frozen=True)
class RaceBudget:
    """The time that a race, and the launches after it, may take.

    One launch is begun even after that.
    """

    end_s: float
    clock: Callable[[], float] = time.monotonic

    def left_s(self) -> float:
        return self.end_s - self.clock()


def race(
    entered: RaceRecord, variants: Targets[RaceLaunch], budget: RaceBudget
) -> Iterator[RaceRecord]:
    """Run a race, and the launches after it; yield what is known after each, and how it ended."""
    rule = _RaceRule(entered, budget)
    for ending in launch(variants, rule):
        if ending is not None and ending.status != Status.OK:
            status, detail = ending.status, ending.detail
            rule.record = replace(rule.record, status=status, detail=detail, is_cut_short=True)
        yield rule.record


class _RaceRule(StopRule[RaceLaunch]):
    """Which variants are launched, for the race and after it; `record` is what is known."""

    def __init__(self, entered: RaceRecord, budget: RaceBudget):
        self.record, self._budget = entered, budget
        self._begin_s = self._launch_s = 0.0
        self._is_final = False

    def next_targets(self) -> Sequence[int]:
        racing = self._next_of_race()
        self._is_final = not racing
        self._begin_s = self._budget.clock()
        return racing or self._next_final() or self._next_slow()

    def add(self, launch: RaceLaunch) -> None:
        self._launch_s = self._budget.clock() - self._begin_s
        launches = [*self.record.launches, replace(launch, is_final=self._is_final)]
        self.record = replace(self.record, launches=launches)

    def withdraw(self, error: UnableError) -> None:
        """Note that a variant is unable; it is not in the next launch."""
        if error.position == 0:
            raise error
        unable = UnableVariant(error.position, error.status, error.detail)
        self.record = replace(self.record, unable=[*self.record.unable, unable])

    def _next_of_race(self) -> list[int]:
        record = self.record
        if record.is_cut_short or record.is_decided:
            return []
        racing = remaining(record)
        if not record.launches:
            return racing
        final_s = FINAL_LAUNCHES * self._expected_s(finalists(record))
        has_time = self._budget.left_s() >= self._expected_s(racing) + final_s
        if has_time and len(record.launches) < MAX_LAUNCHES:
            return racing
        self.record = replace(record, is_cut_short=True)
        return []

    def _next_final(self) -> list[int]:
        final = finalists(self.record)
        count = self._final_launches_of(final)
        if count < FINAL_LAUNCHES and self._budget.left_s() >= self._expected_s(final):
            return final
        if count < MIN_FINAL_LAUNCHES:
            self.record = replace(self.record, is_cut_short=True)
        return []

    def _next_slow(self) -> list[int]:
        """Return the plain loop and those that start slowly, until they have launches enough."""
        slow = [i for i in self.record.slow if i in self.record.able]
        has_enough = self._final_launches_of(slow) >= MIN_FINAL_LAUNCHES
        return [] if not slow or has_enough else [0, *slow]

    def _final_launches_of(self, positions: Collection[int]) -> int:
        after = [launch for launch in self.record.launches if launch.is_final]
        return sum(set(positions) <= set(launch.variants) for launch in after)

    def _expected_s(self, positions: Collection[int]) -> float:
        share = len(positions) / len(self.record.launches[-1].variants)
        return self._launch_s * max(share, _SHARE_OF_START)


def remaining(record: RaceRecord) -> list[int]:
    """Return the variants that stay in a race: contenders, the plain loop, and those in no group.

    Before the first launch, those are all but the slow ones.
    """
    if not record.launches:
        return sorted(record.able.difference(record.slow))
    contenders = (standing.contenders for standing in record.standings.values())
    return sorted(_always_timed(record).union(*contenders))


def finalists(record: RaceRecord) -> list[int]:
    """Return the variants to time after a race: winners, the plain loop, and those in no group."""
    winners = ({each.fastest, each.chosen} for each in record.standings.values())
    return sorted(_always_timed(record).union(*winners))


def _always_timed(record: RaceRecord) -> set[int]:
    return {0} | record.able.difference(record.slow, *record.groups)
