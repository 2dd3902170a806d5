"""Targets and a short plan that the tests of paired comparison share."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mjbench.errors import Failure
from mjbench.interval import Interval
from mjbench.paired import verdict
from mjbench.paired.metrics import Metric
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.outcomes import Verdict
from mjbench.paired.pair_launches import BOTH, PairTargets
from mjbench.paired.records import Judgement, LaunchRow, VerdictRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerProcess
from mjbench.releases import release_names
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


def decided(baseline: Target, candidate: Target, status: Status = Status.OK) -> VerdictRecord:
    """Return an invented verdict on two targets."""
    judgement = Judgement(Verdict.SAME, Interval(1.0, 0.999, 1.001), 8, True)
    sides = baseline.row(), candidate.row()
    return VerdictRecord.of(sides, Metric.TIME, Failure(status, ""), judgement)


class InventedPair(PairTargets):
    """Two sides of which launches are invented: no process is started."""

    is_closed = False

    def __init__(
        self,
        time_limit: TimeLimit,
        invent: Callable[[], LaunchRow],
        place: Callable[..., PlacementControl] = lambda: PlacementControl(False),
    ):
        pool: Any = None
        names = "baseline", "candidate"
        super().__init__(pool, (INSTALLED, INSTALLED), names, Metric.TIME, time_limit)
        self._invent, self._place = invent, place

    def prepare(self) -> None:
        self.placement = self._place()
        self.fix_work()

    def fix_work(self) -> None:
        self._time_limit.start()
        self.baseline_workload = Path("workload")

    def _prepare_blocks(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        raise NotImplementedError

    def launch(self, positions: Sequence[int] = BOTH) -> LaunchRow:
        return self._invent()

    def close(self) -> None:
        self.is_closed = True
