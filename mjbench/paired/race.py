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

from mjbench.errors import InputError
from mjbench.paired.race_record import MIN_FINAL_LAUNCHES, RaceLaunch, RaceRecord, UnableVariant
from mjbench.paired.time_limit import ENDING_ERRORS, ending_of

# Launches in all at most before the race is over, and after it.
MAX_LAUNCHES, FINAL_LAUNCHES = 100, 8
# A launch of a few paths takes at least this share of the time of one of all: it starts a process.
_SHARE_OF_START = 0.25


class UnableError(InputError):
    """A variant cannot go on; `unable` says which, and why."""

    def __init__(self, unable: UnableVariant):
        super().__init__(unable.detail)
        self.unable = unable


@dataclass(frozen=True)
class RaceBudget:
    """The time that a race, and the launches after it, may take.

    Attributes:
      end_s: when they end, by `clock`. One launch is begun even after that.
    """

    end_s: float
    clock: Callable[[], float] = time.monotonic

    def left_s(self) -> float:
        """Return the seconds that are left."""
        return self.end_s - self.clock()


def race(
    entered: RaceRecord,
    launch: Callable[[Sequence[int], bool], RaceLaunch],
    budget: RaceBudget,
) -> Iterator[RaceRecord]:
    """Run a race, and the launches after it; yield what is known after each, and how it ended.

    Args:
      entered: what takes part, without a launch.
      launch: times variants in a fresh process; the flag says whether the race is over.
      budget: of time.
    """
    course = _Course(entered, launch, budget)
    try:
        while course.go_on():
            yield course.record
    except ENDING_ERRORS as error:
        ending = ending_of(error)
        course.record = replace(
            course.record, status=ending.status, detail=ending.detail, is_cut_short=True
        )
    yield course.record


class _Course:
    """The course of one race; `record` is what is known."""

    def __init__(
        self,
        entered: RaceRecord,
        launch: Callable[[Sequence[int], bool], RaceLaunch],
        budget: RaceBudget,
    ):
        self.record, self._launch, self._budget = entered, launch, budget
        self._launch_s = 0.0

    def go_on(self) -> bool:
        """Launch once, for the race or after it; return False where all launches were made.

        A variant that is unable is noted instead, and is not in the next launch.
        """
        if racing := self._next_of_race():
            self._launch_once(racing, is_final=False)
        elif final := self._next_final() or self._next_slow():
            self._launch_once(final, is_final=True)
        else:
            return False
        return True

    def _next_of_race(self) -> list[int]:
        """Return the variants of the next launch of the race; none where it is over."""
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
        """Return the variants of the next launch after the race; none without time for it."""
        final = finalists(self.record)
        count = self._final_launches_of(final)
        if count < FINAL_LAUNCHES and self._budget.left_s() >= self._expected_s(final):
            return final
        if count < MIN_FINAL_LAUNCHES:
            self.record = replace(self.record, is_cut_short=True)
        return []

    def _next_slow(self) -> list[int]:
        """Return the variants of the next launch of those that start slowly, whatever the budget.

        The plain loop is beside them.
        """
        slow = [i for i in self.record.slow if i in self.record.able]
        has_enough = self._final_launches_of(slow) >= MIN_FINAL_LAUNCHES
        return [] if not slow or has_enough else [0, *slow]

    def _final_launches_of(self, positions: Collection[int]) -> int:
        """Return how many launches after the race timed all of these variants."""
        after = [launch for launch in self.record.launches if launch.is_final]
        return sum(set(positions) <= set(launch.variants) for launch in after)

    def _launch_once(self, positions: Sequence[int], is_final: bool) -> None:
        begin_s = self._budget.clock()
        try:
            launched = self._launch(positions, is_final)
        except UnableError as error:
            if error.unable.variant == 0:
                raise
            self.record = replace(self.record, unable=[*self.record.unable, error.unable])
            return
        self._launch_s = self._budget.clock() - begin_s
        self.record = replace(self.record, launches=[*self.record.launches, launched])

    def _expected_s(self, positions: Collection[int]) -> float:
        """Return about how long a launch of these variants takes."""
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
