"""Two targets, timed in alternating blocks in fresh processes: the engine of paired comparisons.

A launch starts one program for each target anew. Both run on one core, with this process,
and take turns in quads, ABBA or BAAB at random (A is the baseline), so that drift and the
order of turns hit both alike; a few times per launch both lay out their memory anew. The quads of
a layout take the sections of the launch's run in turn. Where a block is the whole run, each layout
draws simulations anew. A launch yields one number, the log ratio of all that was timed. Launches
are the samples that `verdict` judges, as many as the verdict needs. While one launch is measured,
the programs of the next start on the other cores.
"""

import contextlib
import itertools
import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjbench.measuring import timing
from mjbench.paired import cores, preparation
from mjbench.paired.calibrator import Calibrator
from mjbench.paired.call_results import ResultsCheck
from mjbench.paired.launches import Targets
from mjbench.paired.metrics import METRICS, Measured
from mjbench.paired.pair_work import STEP_WORK, OperationWork, PairWork, StepWork
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.process_pairs import ProcessPair, ProcessPairs
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.placement import AS_SHIPPED, PlacementPair

# The positions of a baseline and its candidate.
BOTH = (0, 1)


class LaunchedPair(Targets[LaunchRow]):
    """Two sides, which can be launched as often as it takes once they are prepared."""

    def __init__(
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        time_limit: TimeLimit | None = None,
        placements: Callable[[], Iterator[PlacementPair]] = lambda: itertools.repeat(AS_SHIPPED),
    ):
        """Start nothing yet.

        Args:
          releases: that the processes of baseline and candidate import.
          names: of both, for error messages.
          time_limit: starts with the work; None for no limit.
          placements: returns those of the releases' libraries, launch by launch, as
            `placement.schedule` yields them.
        """
        self._pool, self._releases, self._names = pool, releases, names
        self._time_limit, self._placements = time_limit or TimeLimit(), placements
        self._has_timed = False
        self._closing = contextlib.ExitStack()

    @abstractmethod
    def _new_work(self) -> PairWork:
        """Return what both do, and start the time limit; raises what `prepare` does."""

    def prepare(self) -> None:
        """Make sure that both sides can do the work.

        Raises:
          InputError: a side cannot do it.
          ChildError: a side crashed, hung or failed.
          OutOfTimeError: the limit does not allow a launch.
        """
        # those of the first launch import MuJoCo while the work is prepared
        self._pairs = ProcessPairs(self._pool, self._releases, self._names, self._placements())
        self._closing.callback(self._pairs.close)
        self._work = self._new_work()
        self._closing.callback(self._work.close)
        self._calibrator = Calibrator(self._pool, self._releases[0], self._work.nthread)
        self._closing.callback(self._calibrator.close)
        self._pairs.equip(self._work.equip)

    def launch(self, positions: Sequence[int] = BOTH) -> LaunchRow:
        """Measure both once, in fresh processes, on a free core.

        Raises:
          InputError: a side cannot do the work.
          ChildError: a side crashed, hung or failed.
          OutOfTimeError: this is the first launch, and the time limit does not allow it.
        """
        assert tuple(positions) == BOTH, "a pair is launched together"
        self._pairs.wait()
        # work with threads gets all cores, so nothing may start on one of them meanwhile
        threaded = self._work.nthread > 1
        calibrated = self._calibrator.count() if threaded else None
        with self._pairs.launch(None if threaded else cores.freest_core()) as pair:
            launch = replace(self._measure(pair), compilations=self._work.compilations(pair))
        self._has_timed = True
        return replace(launch, cores=calibrated)

    def _measure(self, pair: ProcessPair) -> LaunchRow:
        """Measure a launch; the first one only if it fits the time limit."""
        layouts: list[tuple[list[str], np.ndarray]] = []
        all_blocks_s = math.inf
        while self._needs_layout(len(layouts), all_blocks_s):
            now_s = 1e-9 * sum(self._work.lay_out(pair, is_new_run=not layouts))
            if not self._has_timed and not layouts:  # steps may be heavier than those at the start
                self._time_limit.check_first_launch(self._work.launch_s(now_s))
            all_blocks_s = min(all_blocks_s, now_s)
            layouts.append(time_quads(*pair.processes, self._work.quad_count(now_s)))
        orders = [order for layout_orders, _ in layouts for order in layout_orders]
        ns = np.concatenate([ns for _, ns in layouts]).tolist()
        sizes = [len(layout_orders) for layout_orders, _ in layouts]
        return LaunchRow(pair.core, None, orders, ns, pair.placements, sizes, self._work.nsection)

    def _needs_layout(self, count: int, all_blocks_s: float) -> bool:
        """Return whether a launch lays memory out once more, after `count` times."""
        least, most = self._work.layout_counts(all_blocks_s)
        return count < least or (count < most and not self._pairs.is_next_ready())

    def close(self) -> None:
        """End the processes that were started ahead, and the work."""
        self._closing.close()


class TargetPair(LaunchedPair):
    """Two targets; files are removed at the end, but the baseline's workload.

    Attributes:
      is_prepared: whether both can do the same work.
      work_check: how their work compares; None for operations.
      results: how what an operation computes compares; None for steps.
      baseline_workload: file of the baseline's `PortableWorkload`, final states included; it lasts
        as long as the pool. None for operations.
    """

    def __init__(
        self,
        pool: WorkerPool,
        baseline: Target,
        candidate: Target,
        sizes: Sizes | None = None,
        time_limit: TimeLimit | None = None,
        placements: Callable[[], Iterator[PlacementPair]] = lambda: itertools.repeat(AS_SHIPPED),
    ):
        """Start nothing yet.

        Args:
          sizes: of a run; None for the usual ones.
          time_limit: starts when the models are loaded; None for no limit.
          placements: see `LaunchedPair`.
        """
        targets = baseline, candidate
        releases = baseline.release, candidate.release
        super().__init__(pool, releases, preparation.describe(targets), time_limit, placements)
        self._targets, self._sizes = targets, sizes or Sizes()
        self.is_prepared = False
        self.work_check: WorkCheck | None = None
        self.results: ResultsCheck | None = None
        self.baseline_workload: Path | None = None

    def _new_work(self) -> PairWork:
        metric = self._sizes.metric
        work: OperationWork | StepWork
        if METRICS[metric].measured == Measured.OPERATION:
            work = OperationWork(self._pool, self._targets, metric, self._time_limit)
            self.results = work.results
        else:
            kind = STEP_WORK.get(metric, StepWork)
            work = kind(self._pool, self._targets, self._sizes, self._time_limit)
            self.work_check, self.baseline_workload = work.work_check, work.workloads[0]
        self.is_prepared = True
        return work


def time_quads(
    baseline: WorkerProcess, candidate: WorkerProcess, count: int
) -> tuple[list[str], np.ndarray]:
    """Time `count` quads; return their orders and (count, 4) nanoseconds."""
    processes = {"A": baseline, "B": candidate}
    for process in processes.values():
        process.ask(Worker.time_blocks)
    orders = timing.draw_orders(count)
    ns = np.array([[processes[letter].time_block() for letter in order] for order in orders])
    for process in processes.values():
        process.end_blocks()
    return orders, ns
