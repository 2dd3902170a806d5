"""Two sides, timed in alternating blocks in fresh processes: the engine of paired comparisons.

A launch starts one program for each side anew. Both run on one core, with this process,
and take turns in quads, ABBA or BAAB at random (A is the baseline), so that drift and the
order of turns hit both alike; a few times per launch both lay out their memory anew. The quads of
a layout take the sections of the launch's run in turn. Where a block is the whole run, each layout
draws simulations anew. A launch yields one number, the log ratio of all that was timed. Launches
are the samples that `verdict` judges, as many as the verdict needs. While one launch is measured,
the programs of the next start on the other cores.

`target_pair` has the pairs of models, which do steps or an operation around them, and
`function_verdict` those of functions.
"""

import contextlib
import itertools
import math
import random
from abc import abstractmethod
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjbench.errors import MjbenchError
from mjbench.host import machine
from mjbench.measuring import timing
from mjbench.measuring.calls import Compilation
from mjbench.paired import cores, moved_check
from mjbench.paired.call_results import ResultsDifference
from mjbench.paired.launches import StopRule, Targets
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.records import LaunchRow, Pair, WorkDifference
from mjbench.paired.time_limit import MAX_LAYOUTS, TimeLimit, launch_s, layout_count, quad_count
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.releases.release_names import ReleaseSpec

# The positions of the baseline and the candidate.
BOTH = (0, 1)


@dataclass(frozen=True, eq=False)
class ProcessPair:
    """The processes of one launch, and the core that they are measured on; None for all."""

    processes: tuple[WorkerProcess, WorkerProcess]
    placements: PlacementPair
    core: int | None = None


class ProcessPairs:
    """Starts two processes for each launch, one in each of two releases.

    A process that fails raises its error in `wait`, so that it does not end the launches before its
    own.
    """

    def __init__(
        self, pool: WorkerPool, releases: tuple[ReleaseSpec, ReleaseSpec], names: tuple[str, str]
    ):
        """Start nothing yet."""
        self._pool, self._releases, self._names = pool, releases, names
        self._knows_work = False
        # Those that were started ahead, for the next launch.
        self._next: ProcessPair | None = None
        # Those whose launches are over, and which are ended while the next ones start.
        self._finished: list[ProcessPair] = []
        self._failure: MjbenchError | None = None

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """Have the processes of a launch read what they need, without waiting."""

    def start(self, placements: Iterator[PlacementPair] | None = None) -> None:
        """Start the processes of the first launch; `equip_all` tells what they need."""
        self._placements = placements or itertools.repeat(AS_SHIPPED)
        self._seeds = self._pool.seeds(self._releases)
        self._next_seeds = next(self._seeds)
        self._start_ahead(cores.USABLE)

    def equip_all(self) -> None:
        """Have the processes of every launch equipped, the next one's now."""
        self._knows_work = True
        if self._next is not None:
            self.equip(self._next.processes)

    def wait(self) -> None:
        """Wait until the processes of the next launch are ready."""
        try:
            if self._failure is not None:
                raise self._failure
            next_pair = self._start_ahead(cores.USABLE)
            for process, release in zip(next_pair.processes, self._releases, strict=True):
                self._pool.wait_for(process, release)
        except BaseException:
            self.end_all()
            raise

    @contextlib.contextmanager
    def launched(self, core: int | None) -> Iterator[ProcessPair]:
        """Yield the processes of a launch, which must be ready, with this thread on their core.

        The processes of the next launch start on other cores meanwhile. Ask nothing of the
        processes of this launch after the block: they are ended now or later.

        Args:
          core: that the launch is measured on; None for all of them, where nothing else may run.
        """
        assert self._next is not None, "`wait` has started them"
        pair, self._next = self._next, None
        others = cores.beside(core) if core is not None and machine.usable_cores() > 1 else ()
        try:
            ahead = self._start_ahead(others) if others else None
            self._end_finished()
            with cores.pinned(core):
                yield replace(pair, core=core)
            if ahead is not None:
                cores.confine([process.pid for process in ahead.processes], cores.USABLE)
        finally:
            self._finished.append(pair)
            if not others:  # nothing starts meanwhile, and what comes next may need all memory
                self._end_finished()

    def is_next_ready(self) -> bool:
        """Return whether nothing is started ahead that is still starting."""
        try:
            return (
                self._failure is not None
                or self._next is None
                or all(process.is_ready() for process in self._next.processes)
            )
        except MjbenchError as error:
            self._failure = error
            return True

    def end_all(self) -> None:
        if self._next is not None:
            self._finished.append(self._next)
        self._next, self._failure = None, None
        self._end_finished()

    def _end_finished(self) -> None:
        pairs, self._finished = self._finished, []
        self._pool.end([process for pair in pairs for process in pair.processes])

    def _start_ahead(self, allowed: Collection[int]) -> ProcessPair:
        """Return the processes of the next launch; start them if need be, without waiting."""
        if self._next is not None:
            return self._next
        seeds, self._next_seeds = self._next_seeds, next(self._seeds)
        placements = next(self._placements)
        both = (placements.old, placements.new)
        started: dict[int, WorkerProcess] = {}
        try:
            for i in random.sample(BOTH, 2):  # neither of the two is always the first
                started[i] = self._pool.start(
                    self._releases[i], self._names[i], both[i], i, allowed, seeds
                )
            pair = ProcessPair((started[0], started[1]), placements)
            if self._knows_work:
                self.equip(pair.processes)
            if self._next_seeds.program != seeds.program:
                for i in random.sample(BOTH, 2):
                    release = self._releases[i]
                    self._pool.start_program_early(release, i, allowed, self._next_seeds)
        except BaseException:
            self._pool.end(list(started.values()))
            raise
        self._next = pair
        return pair


class PairTargets(ProcessPairs, Targets[LaunchRow]):
    """Two sides, the baseline and the candidate: each launch measures both.

    Attributes:
      nthread: threads or processes that the work takes; with one, launches run on one core.
      nsection: sections of a run, which blocks time one after the other (see `loop_sections`).
      work: what both do, and how it differs; of steps only.
      results: how what both compute compares; of operations only.
      baseline_workload: file of the baseline's `PortableWorkload`, final states included, which
        lasts as long as the pool; of steps only.
      placement: whether launches average over placements of machine code; None before `prepare`.
    """

    nthread: int = 1
    nsection: int = 1
    work: WorkDifference | None = None
    results: ResultsDifference | None = None
    baseline_workload: Path | None = None
    placement: PlacementControl | None = None

    def __init__(
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        metric: Metric,
        time_limit: TimeLimit,
        as_shipped: bool = True,
    ):
        """Start nothing yet, nor the time limit, which starts with the work."""
        super().__init__(pool, releases, names)
        self._metric, self._time_limit = METRICS[metric], time_limit
        self._averages = not as_shipped and self._metric.follows_placement
        self._is_first = True
        self._counting: WorkerProcess | None = None
        self._closing = contextlib.ExitStack()

    @abstractmethod
    def fix_work(self) -> None:
        """Start the time limit, and fix what both sides do.

        Raises:
          InputError: one of them cannot do it.
          MachineError: a process crashed, hung or failed.
          OutOfTimeError: the time limit does not allow one launch.
        """

    @abstractmethod
    def _prepare_blocks(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        """Have a process ready to time blocks; return the nanoseconds of one of each section.

        It runs on the cores `allowed` from now on; none for no change.
        """

    def compilations(self, pair: ProcessPair) -> Pair[Compilation] | None:
        return None

    @property
    def log_scale(self) -> float:
        """What turns log ratios of the time of a step into those that are judged.

        Where timesteps differ, they are of the time of a simulated second.
        """
        return self.work.log_scale if self.work and self._metric.is_of_steps else 0.0

    def prepare(self) -> None:
        """Make sure that both sides can do the work; see `fix_work` for what this raises."""
        self.placement = PlacementControl(False)
        if self._averages:
            self.placement = moved_check.placement_control(self._pool, *self._releases)
        least = self._time_limit.min_launches
        self._time_limit.min_launches = self.placement.launches_with(least)
        # those of the first launch import MuJoCo while the work is fixed
        self._closing.callback(self.end_all)
        self.start(self.placement.placements())
        self.fix_work()
        self.equip_all()

    def launch(self, positions: Sequence[int] = BOTH) -> LaunchRow:
        """Measure both once, in fresh processes, on a free core."""
        self.wait()
        # work with threads gets all cores, so nothing may start on one of them meanwhile
        threaded = self.nthread > 1
        had = self._cores_had() if threaded else None
        with self.launched(None if threaded else cores.freest_core()) as pair:
            launch = self._measure(pair)
            return replace(launch, cores=had, compilations=self.compilations(pair))

    def close(self) -> None:
        self._closing.close()

    def _cores_had(self) -> float:
        """Return how many cores threads get now.

        The process that counts them starts with the first count, because counting takes memory.
        """
        if cores.countable(self.nthread) == 1:
            return 1.0
        if self._counting is None:
            counting = self._pool.ready(self._releases[0])
            self._counting = self._closing.enter_context(counting)
        return self._counting.count_cores(self.nthread) or 1.0

    def _measure(self, pair: ProcessPair) -> LaunchRow:
        """Measure a launch; the first one only if it fits the time limit."""
        orders: list[str] = []
        layouts: list[np.ndarray] = []
        all_blocks_s = math.inf
        while self._needs_layout(len(layouts), all_blocks_s):
            now_s = 1e-9 * sum(self.lay_out(pair, is_new_run=not layouts))
            if self._is_first:  # steps may be heavier than those at the start
                self._time_limit.check_first_launch(self.launch_s(now_s))
            self._is_first = False
            all_blocks_s = min(all_blocks_s, now_s)
            count = 1 if self._metric.is_read_once else quad_count(now_s, self.nsection)
            layout_orders, ns = time_quads(*pair.processes, count)
            orders += layout_orders
            layouts.append(ns)
        ns, sizes = np.concatenate(layouts), [len(each) for each in layouts]
        return LaunchRow(
            pair.core, None, orders, ns.tolist(), pair.placements, sizes, self.nsection
        )

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """Lay out memory anew; return the nanoseconds of one block of each section, of both.

        Args:
          is_new_run: whether a run that is divided may be another one than in the layout before.
        """
        allowed = cores.usable(pair.core)
        both = random.sample(BOTH, 2)
        ns = {i: self._prepare_blocks(pair.processes[i], i, allowed) for i in both}
        return ns[0], ns[1]

    def _needs_layout(self, count: int, all_blocks_s: float) -> bool:
        if self._metric.is_read_once:
            return count < 1
        if count < layout_count(all_blocks_s, self.nsection):
            return True
        return count < MAX_LAYOUTS and not self.is_next_ready()

    def launch_s(self, all_blocks_s: float) -> float:
        is_read_once = self._metric.is_read_once
        return all_blocks_s if is_read_once else launch_s(all_blocks_s, self.nsection)


class CountRule(StopRule[LaunchRow]):
    """Launch both sides a number of times, as far as a time limit allows."""

    def __init__(self, time_limit: TimeLimit, count: float = math.inf):
        self._time_limit, self._count = time_limit, count
        self._before_s = 0.0  # of the time limit, spent before the first launch
        self.launches: list[LaunchRow] = []

    @property
    def has_answer(self) -> bool:
        """Whether the launches until now are not for nothing if there is no other."""
        return False

    @property
    def has_enough(self) -> bool:
        return len(self.launches) >= self._count

    def next_targets(self) -> Sequence[int]:
        count = len(self.launches)
        if count == 0:
            self._before_s = self._time_limit.spent_s()
        elif self.has_enough or not self._time_limit.allows_another(
            count, self._before_s, self.has_answer
        ):
            return ()
        return BOTH

    def add(self, launch: LaunchRow) -> None:
        self.launches.append(launch)


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
