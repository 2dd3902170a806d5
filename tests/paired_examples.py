"""Targets and a short plan that the tests of paired comparison share."""

from collections.abc import Callable, Iterator
from typing import Any

from mjbench.measuring.ratio import Ratio
from mjbench.paired import verdict
from mjbench.paired.outcomes import Verdict
from mjbench.paired.pair_launches import LaunchedPair, PairWork
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.verdict import Judgement, PairedResult
from mjbench.releases import release_names
from mjbench.releases.placement import PlacementPair
from mjbench.simulation import models
from mjbench.simulation.starts import KEYFRAME_STARTS
from mjbench.status import Status

INSTALLED = release_names.parse_release(release_names.INSTALLED)
CARTPOLE = Target(INSTALLED, models.resolve("cartpole"))
CUBES = Target(INSTALLED, models.resolve("cube_table"))
# One launch, without a settling run: verdicts cost time, and how often they are right is not what
# is tested.
BRIEF_SIZES = Sizes(starts=KEYFRAME_STARTS)
BRIEF = verdict.VerdictPlan(time_limit_s=0.1, sizes=BRIEF_SIZES, as_shipped=True)


def decided(baseline: Target, candidate: Target, status: Status = Status.OK) -> PairedResult:
    """Return an invented verdict on two targets."""
    judgement = Judgement(Verdict.SAME, Ratio(1.0, 0.999, 1.001), 8, True)
    return PairedResult(baseline=baseline, candidate=candidate, status=status, judgement=judgement)


class InventedPair(LaunchedPair):
    """Two sides of which launches are invented: no process is started."""

    is_closed = False

    def __init__(self, time_limit: TimeLimit, invent: Callable[[], LaunchRow], work: Any = None):
        pool: Any = None
        super().__init__(pool, (INSTALLED, INSTALLED), ("baseline", "candidate"), time_limit)
        self._invent, self._invented_work = invent, work

    def prepare(self, placements: Iterator[PlacementPair] | None = None) -> None:
        self.work = self._new_work()

    def _new_work(self) -> PairWork:
        self.time_limit.start()
        work: PairWork = self._invented_work
        return work

    def _launch(self) -> LaunchRow:
        return self._invent()

    def close(self) -> None:
        self.is_closed = True
