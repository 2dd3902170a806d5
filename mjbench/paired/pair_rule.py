"""Launch a baseline and a candidate until there is an answer, or time is up."""

import time
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from mjbench.paired.call_results import ResultsCheck
from mjbench.paired.launches import StopRule, launch
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.protocol import BOTH, LaunchedPair, TargetPair
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import PlacementPair
from mjbench.status import Status


@dataclass(frozen=True)
class Sufficiency:
    """What a rule says of the launches so far.

    Attributes:
      is_enough: whether no more are needed.
      has_answer: whether they are not for nothing if time is up.
    """

    is_enough: bool
    has_answer: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Launched:
    """What launches of two targets gave, and how they ended.

    Attributes:
      status: how they ended; `OK` also where time ran out.
      detail: one line; empty when ok, unless time ran out before there were enough launches.
      is_enough: whether the rule ended them.
      seconds: from start to end, the workers' start included.
      work_check: whether both did the same work; None where it ended before that.
      results: how what an operation computes compares; None for steps.
      workload_file: the baseline's `PortableWorkload`, which lasts as long as the pool; None
        likewise.
    """

    status: Status
    detail: str = ""
    launches: Sequence[LaunchRow] = ()
    is_enough: bool = False
    seconds: float = 0.0
    work_check: WorkCheck | None = None
    results: ResultsCheck | None = None
    workload_file: Path | None = None


class LaunchRule(StopRule[LaunchRow]):
    """When launches of two sides are enough.

    Class attributes:
      purpose: what they are for, such as `a verdict`.
    """

    purpose: ClassVar[str]

    def __init__(self, limit: TimeLimit, clock: Callable[[], float] = time.monotonic):
        """Start nothing yet.

        Args:
          limit: no launch begins after it.
        """
        self.launches: list[LaunchRow] = []
        self._limit, self._clock = limit, clock
        self._before_s = 0.0
        self._sufficiency = Sufficiency(is_enough=False, has_answer=False)

    @abstractmethod
    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        """Return whether launches are enough; called after each."""

    def next_targets(self) -> Sequence[int]:
        """See `StopRule.next_targets`."""
        if not self.launches:
            self._before_s = self._limit.spent_s()
            return BOTH
        if self._sufficiency.is_enough:
            return ()
        count, has_answer = len(self.launches), self._sufficiency.has_answer
        return BOTH if self._limit.allows_another(count, self._before_s, has_answer) else ()

    def add(self, launch: LaunchRow) -> None:
        """See `StopRule.add`."""
        self.launches.append(launch)
        self._sufficiency = self.look(self.launches)

    def run_pair(self, pair: LaunchedPair) -> Launched:
        """Launch both sides until there is an answer, or time is up.

        Where a side crashes, hangs or fails, or Ctrl-C is pressed, the result says so, and holds
        what was measured until then.
        """
        begin_s = self._clock()
        *_, ending = launch(pair, self)
        assert ending is not None, "the last one says how it ended"
        return Launched(
            status=ending.status,
            detail=ending.detail,
            launches=self.launches,
            is_enough=self._sufficiency.is_enough,
            seconds=self._clock() - begin_s,
        )


class PairRule(LaunchRule):
    """When launches of two targets are enough."""

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        sizes: Sizes,
        time_limit_s: float,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Start nothing yet.

        Args:
          time_limit_s: seconds from when the models are loaded, after which no launch begins.
        """
        super().__init__(TimeLimit(time_limit_s, clock=clock, purpose=self.purpose), clock)
        self._pool = pool
        self._pair = TargetPair(pool, *targets, sizes, self._limit, self._first_placements)

    @abstractmethod
    def placements(self, pool: WorkerPool) -> Iterator[PlacementPair]:
        """Return the placements of the targets' libraries, launch by launch.

        Raises:
          InputError: a release does not exist.
          MachineError: a release cannot be installed, or moved.
        """

    @abstractmethod
    def min_launches(self) -> int:
        """Return how many launches an answer needs; called after `placements`."""

    @property
    def work_check(self) -> WorkCheck | None:
        """How the work of both targets compares, once they are prepared; None for operations."""
        return self._pair.work_check

    def run(self) -> Launched:
        """Launch both targets until there is an answer, or time is up (see `run_pair`)."""
        launched, pair = self.run_pair(self._pair), self._pair
        if not pair.is_prepared:
            return launched
        return replace(
            launched,
            work_check=pair.work_check,
            results=pair.results,
            workload_file=pair.baseline_workload,
        )

    def _first_placements(self) -> Iterator[PlacementPair]:
        placements = self.placements(self._pool)
        self._limit.min_launches = self.min_launches()
        return placements
