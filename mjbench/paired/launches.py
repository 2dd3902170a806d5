"""Launch two targets until a stop rule has enough, or time is up.

Verdicts and placement spreads are stop rules on this loop.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from mjbench.errors import Failure
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.protocol import TargetPair
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import ENDING_ERRORS, TimeLimit, ending_of
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import PlacementPair
from mjbench.status import Status


@dataclass(frozen=True)
class Sufficiency:
    """What a stop rule says of the launches so far.

    Attributes:
      is_enough: whether no more are needed.
      has_answer: whether they are not for nothing if time is up.
    """

    is_enough: bool
    has_answer: bool


class StopRule(ABC):
    """When launches are enough.

    Class attributes:
      purpose: what they are for, such as `a verdict`.
    """

    purpose: ClassVar[str]

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

    @abstractmethod
    def look(self, launches: Sequence[LaunchRow], work_check: WorkCheck) -> Sufficiency:
        """Return whether launches are enough; called after each."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Launched:
    """What launches of two targets gave, and how they ended.

    Attributes:
      status: how they ended; `OK` also where time ran out.
      detail: one line; empty when ok, unless time ran out before there were enough launches.
      is_enough: whether the stop rule ended them.
      seconds: from start to end, the workers' start included.
      work_check: whether both did the same work; None where it ended before that.
      workload_file: the baseline's `PortableWorkload`, which lasts as long as the pool; None
        likewise.
    """

    status: Status
    detail: str = ""
    launches: Sequence[LaunchRow] = ()
    is_enough: bool = False
    seconds: float = 0.0
    work_check: WorkCheck | None = None
    workload_file: Path | None = None


def launch(
    pool: WorkerPool,
    targets: tuple[Target, Target],
    sizes: Sizes,
    rule: StopRule,
    time_limit_s: float,
    clock: Callable[[], float] = time.monotonic,
) -> Launched:
    """Launch baseline and candidate until a rule has enough, or time is up.

    Where a target crashes, hangs or fails, or Ctrl-C is pressed, the result says so, and holds what
    was measured until then.

    Args:
      time_limit_s: seconds from when the models are loaded, after which no launch begins.
    """
    begin_s = clock()
    launches: list[LaunchRow] = []
    pair: TargetPair | None = None
    is_enough, ending = False, Failure(Status.OK, "")
    try:
        placements = rule.placements(pool)
        time_limit = TimeLimit(time_limit_s, rule.min_launches(), clock, rule.purpose)
        pair = TargetPair(pool, *targets, sizes, time_limit, placements)
        before_s, can_go_on = time_limit.spent_s(), True
        while not is_enough and can_go_on:
            launches.append(pair.launch())
            sufficiency = rule.look(launches, pair.work_check)
            is_enough = sufficiency.is_enough
            can_go_on = is_enough or time_limit.allows_another(
                len(launches), before_s, sufficiency.has_answer
            )
    except ENDING_ERRORS as error:
        ending = ending_of(error)
    finally:
        if pair is not None:
            pair.close()
    return Launched(
        status=ending.status,
        detail=ending.detail,
        launches=launches,
        is_enough=is_enough,
        seconds=clock() - begin_s,
        work_check=pair.work_check if pair else None,
        workload_file=pair.baseline_workload if pair else None,
    )
