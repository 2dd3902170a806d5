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

import numpy as np

from mjbench.measuring import timing
from mjbench.paired import cores
from mjbench.paired.launches import Targets
from mjbench.paired.metrics import METRICS, Measured
from mjbench.paired.pair_work import OperationWork, PairWork, StepWork
from mjbench.paired.preparation import describe
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
        time_limit: TimeLimit,
        placements: Callable[[], Iterator[PlacementPair]] = lambda: itertools.repeat(AS_SHIPPED),
    ):
        """Start nothing yet.

        Args:
          time_limit: starts with the work.
          placements: returns those of the releases' libraries, launch by launch, as
            `placement.schedule` yields them.
        """
        self._pool, self._releases, self._names = pool, releases, names
        self.time_limit, self._placements = time_limit, placements
        self.work: PairWork | None = None
        self._counting: WorkerProcess | None = None
        self._has_timed = False
        self._closing = contextlib.ExitStack()

    @abstractmethod
    def _new_work(self) -> PairWork:
        """Return what both do, and start the time limit."""

    def prepare(self) -> None:
        """Make sure that both sides can do the work."""
        # those of the first launch import MuJoCo while the work is prepared
        self._pairs = ProcessPairs(self._pool, self._releases, self._names, self._placements())
        self._closing.callback(self._pairs.close)
        self.work = self._new_work()
        self._closing.callback(self.work.close)
        self._pairs.equip(self.work.equip)

    def launch(self, positions: Sequence[int] = BOTH) -> LaunchRow:
        """Measure both once, in fresh processes, on a free core."""
        assert tuple(positions) == BOTH, "a pair is launched together"
        assert self.work is not None, "it was prepared"
        self._pairs.wait()
        # work with threads gets all cores, so nothing may start on one of them meanwhile
        threaded = self.work.nthread > 1
        had = self._cores_had(self.work.nthread) if threaded else None
        with self._pairs.launch(None if threaded else cores.freest_core()) as pair:
            launch = self._measure(pair, self.work)
            launch = replace(launch, cores=had, compilations=self.work.compilations(pair))
        self._has_timed = True
        return launch

    def _cores_had(self, nthread: int) -> float:
        """Return how many cores threads get now.

        The process that counts them starts with the first count, because counting takes memory.
        """
        if cores.countable(nthread) == 1:
            return 1.0
        if self._counting is None:
            self._counting = self._pool.start(self._releases[0])
            self._closing.callback(self._pool.end, [self._counting])
            self._counting.wait()
        return cores.count(self._counting, nthread) or 1.0

    def _measure(self, pair: ProcessPair, work: PairWork) -> LaunchRow:
        """Measure a launch; the first one only if it fits the time limit."""
        layouts: list[tuple[list[str], np.ndarray]] = []
        all_blocks_s = math.inf
        while self._needs_layout(len(layouts), work.layout_counts(all_blocks_s)):
            now_s = 1e-9 * sum(work.lay_out(pair, is_new_run=not layouts))
            if not self._has_timed and not layouts:  # steps may be heavier than those at the start
                self.time_limit.check_first_launch(work.launch_s(now_s))
            all_blocks_s = min(all_blocks_s, now_s)
            layouts.append(time_quads(*pair.processes, work.quad_count(now_s)))
        orders = [order for layout_orders, _ in layouts for order in layout_orders]
        ns = np.concatenate([ns for _, ns in layouts]).tolist()
        sizes = [len(layout_orders) for layout_orders, _ in layouts]
        return LaunchRow(pair.core, None, orders, ns, pair.placements, sizes, work.nsection)

    def _needs_layout(self, count: int, bounds: tuple[int, int]) -> bool:
        least, most = bounds
        return count < least or (count < most and not self._pairs.is_next_ready())

    def close(self) -> None:
        self._closing.close()


class TargetPair(LaunchedPair):
    """Two targets; files are removed at the end, but the baseline's workload."""

    def __init__(
        self,
        pool: WorkerPool,
        baseline: Target,
        candidate: Target,
        sizes: Sizes | None = None,
        time_limit: TimeLimit | None = None,
        placements: Callable[[], Iterator[PlacementPair]] = lambda: itertools.repeat(AS_SHIPPED),
    ):
        self._targets, self._sizes = (baseline, candidate), sizes or Sizes()
        releases, names = (baseline.release, candidate.release), describe(self._targets)
        super().__init__(pool, releases, names, time_limit or TimeLimit(), placements)

    def _new_work(self) -> PairWork:
        metric = self._sizes.metric
        if METRICS[metric].measured == Measured.OPERATION:
            return OperationWork(self._pool, self._targets, metric, self.time_limit)
        return StepWork(self._pool, self._targets, self._sizes, self.time_limit)


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
