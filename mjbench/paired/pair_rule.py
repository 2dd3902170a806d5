"""Launch a baseline and a candidate until there is an answer, or time is up."""

import time
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
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
    """When launches of two sides suffice for their purpose; none begins after the time limit."""

    purpose: ClassVar[str]

    def __init__(self, pair: LaunchedPair, clock: Callable[[], float] = time.monotonic):
        self.launches: list[LaunchRow] = []
        self._pair, self._limit, self._clock = pair, pair.time_limit, clock
        self._before_s = 0.0
        self._sufficiency = Sufficiency(is_enough=False, has_answer=False)

    @abstractmethod
    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        """Return whether launches are enough; called after each."""

    def next_targets(self) -> Sequence[int]:
        if not self.launches:
            self._before_s = self._limit.spent_s()
            return BOTH
        if self._sufficiency.is_enough:
            return ()
        count, has_answer = len(self.launches), self._sufficiency.has_answer
        return BOTH if self._limit.allows_another(count, self._before_s, has_answer) else ()

    def add(self, launch: LaunchRow) -> None:
        self.launches.append(launch)
        self._sufficiency = self.look(self.launches)

    def run(self) -> Launched:
        """Launch both sides until there is an answer, or time is up.

        Where a side crashes, hangs or fails, or Ctrl-C is pressed, the result says so, and holds
        what was measured until then.
        """
        begin_s = self._clock()
        *_, ending = launch(self._pair, self)
        assert ending is not None, "the last one says how it ended"
        work = self._pair.work
        return Launched(
            status=ending.status,
            detail=ending.detail,
            launches=self.launches,
            is_enough=self._sufficiency.is_enough,
            seconds=self._clock() - begin_s,
            work_check=work.work_check if work else None,
            results=work.results if work else None,
            workload_file=work.baseline_workload if work else None,
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
        limit = TimeLimit(time_limit_s, clock=clock, purpose=self.purpose)
        super().__init__(TargetPair(pool, *targets, sizes, limit, self._first_placements), clock)
        self._pool = pool

    @abstractmethod
    def placements(self, pool: WorkerPool) -> Iterator[PlacementPair]:
        """Return the placements of the targets' libraries, launch by launch."""

    @abstractmethod
    def min_launches(self) -> int:
        """Return how many launches an answer needs; called after `placements`."""

    def _first_placements(self) -> Iterator[PlacementPair]:
        placements = self.placements(self._pool)
        self._limit.min_launches = self.min_launches()
        return placements
