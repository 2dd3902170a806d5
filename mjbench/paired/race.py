"""Which way of stepping is the fastest: a race of paths over launches.

A launch is a fresh process in which every path that is still in the race is timed beside the plain
loop. Paths leave once they are certainly slower than the fastest of their loop. The race ends when
no path that is left can be faster than the fastest by `MARGIN`. The winner of a race is flattered
by it, so launches after the race give the figures of the paths that won, and of the plain loop.
`race` runs it; `race_record` says what follows from its launches.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench.errors import InputError
from mjbench.paired.race_record import MIN_FINAL_LAUNCHES, RaceLaunch, RaceRecord, UnableVariant
from mjbench.paired.time_limit import ENDING_ERRORS, ending_of

# Launches of a race at least, and those after it at most.
MIN_LAUNCHES, FINAL_LAUNCHES = 3, 8
# Launches of a race at most.
MAX_LAUNCHES = 100
# A launch of a few paths takes at least this share of the time of one of all: it starts a process.
_SHARE_OF_START = 0.25


class UnableError(InputError):
    """A variant cannot go on.

    Attributes:
      unable: which, and why.
    """

    def __init__(self, unable: UnableVariant):
        super().__init__(unable.detail)
        self.unable = unable


@dataclass(frozen=True)
class RaceBudget:
    """The time that a race, and the launches after it, may take.

    Attributes:
      end_s: when they end, by `clock`. One launch is begun even after that.
      clock: returns seconds.
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
        for run in (course.run_race, course.run_final, course.run_slow):
            for _ in run():
                yield course.record
    except ENDING_ERRORS as error:
        ending = ending_of(error)
        course.record = replace(
            course.record, status=ending.status, detail=ending.detail, is_cut_short=True
        )
    yield course.record


class _Course:
    """The course of one race.

    Attributes:
      record: what is known.
    """

    def __init__(
        self,
        entered: RaceRecord,
        launch: Callable[[Sequence[int], bool], RaceLaunch],
        budget: RaceBudget,
    ):
        self.record, self._launch, self._budget = entered, launch, budget
        self._going_on = [i for i in range(len(entered.variants)) if i not in entered.slow]
        self._launch_s = 0.0

    def run_race(self) -> Iterator[None]:
        """Launch until the race is decided, or only the time for the launches after it is left."""
        is_decided = False
        while not is_decided and len(self.record.launches) < MAX_LAUNCHES:
            if self.record.launches and self._budget.left_s() < self._launch_s + self._reserve_s():
                break
            yield from self._attempt(is_final=False)
            self._going_on, is_decided = remaining(self.record, self._going_on)
        self.record = replace(self.record, is_cut_short=not is_decided)
        self._going_on = finalists(self.record, self._going_on)

    def run_final(self) -> Iterator[None]:
        """Launch what won, as often as there is time for."""
        self._launch_s *= self._share_of_final()
        for count in range(FINAL_LAUNCHES):
            if self._budget.left_s() < self._launch_s:
                if count < MIN_FINAL_LAUNCHES:
                    self.record = replace(self.record, is_cut_short=True)
                return
            yield from self._attempt(is_final=True)

    def run_slow(self) -> Iterator[None]:
        """Launch what starts slowly, beside the plain loop, whatever the budget."""
        self._going_on = [0, *self.record.slow]
        for _ in range(MIN_FINAL_LAUNCHES if self.record.slow else 0):
            if len(self._going_on) > 1:
                yield from self._attempt(is_final=True)

    def _attempt(self, is_final: bool) -> Iterator[None]:
        """Launch once, again without each variant that is unable."""
        while True:
            begin_s = self._budget.clock()
            try:
                launched = self._launch(self._going_on, is_final)
            except UnableError as error:
                unable = error.unable
                if unable.variant == 0:
                    raise
                self.record = replace(self.record, unable=[*self.record.unable, unable])
                self._going_on = [i for i in self._going_on if i != unable.variant]
                yield
                continue
            self._launch_s = self._budget.clock() - begin_s
            self.record = replace(self.record, launches=[*self.record.launches, launched])
            yield
            return

    def _reserve_s(self) -> float:
        """Return about how long the launches after the race take."""
        return FINAL_LAUNCHES * self._launch_s * self._share_of_final()

    def _share_of_final(self) -> float:
        """Return about which share of the last launch's time one after the race takes."""
        timed = self.record.launches[-1].variants
        return max(len(finalists(self.record, self._going_on)) / len(timed), _SHARE_OF_START)


def remaining(record: RaceRecord, going_on: Sequence[int]) -> tuple[list[int], bool]:
    """Return the variants that stay in a race, and whether all of its groups are decided.

    The plain loop stays, and so do variants that are in no group.
    """
    standings = record.standings()
    grouped = set().union(*record.groups)
    stay = {i for i in going_on if i == 0 or i not in grouped}
    is_decided = len(record.launches) >= MIN_LAUNCHES
    for place in standings:
        assert place is not None, "there was a launch"
        is_decided &= place.is_decided
        stay |= {place.fastest, place.chosen, *place.rivals}
    return sorted(stay.intersection(going_on)), is_decided


def finalists(record: RaceRecord, going_on: Sequence[int]) -> list[int]:
    """Return the variants to time after a race: winners, the plain loop, and those in no group."""
    grouped = set().union(*record.groups)
    final = {i for i in going_on if i == 0 or i not in grouped}
    for place in record.standings():
        assert place is not None, "there was a launch"
        final |= {place.fastest, place.chosen}
    return sorted(final.intersection(going_on))
