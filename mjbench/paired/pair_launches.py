"""Two sides, timed in alternating blocks in fresh processes: the engine of paired comparisons.

A launch starts one program for each side anew. Both run on one core, with this process,
and take turns in quads, ABBA or BAAB at random (A is the baseline), so that drift and the
order of turns hit both alike; a few times per launch both lay out their memory anew. The quads of
a layout take the sections of the launch's run in turn. Where a block is the whole run, each layout
draws simulations anew. A launch yields one number, the log ratio of all that was timed. Launches
are the samples that `verdict` judges, as many as the verdict needs. While one launch is measured,
the programs of the next start on the other cores.

What the sides do in a launch is a `PairWork`: of models, steps or an operation around them (see
`target_pair`), of functions, calls (see `function_verdict`).
"""

import contextlib
import itertools
import math
import random
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from mjbench.errors import Failure, MjbenchError
from mjbench.host import machine
from mjbench.measuring import timing
from mjbench.measuring.calls import Compilation
from mjbench.paired import cores
from mjbench.paired.call_results import ResultsCheck
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.records import LaunchRow, Pair
from mjbench.paired.time_limit import (
    ENDING_ERRORS,
    MAX_LAYOUTS,
    TimeLimit,
    ending_of,
    launch_s,
    layout_count,
    quad_count,
)
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation import changed_work
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import Starts
from mjbench.simulation.state_drift import StateDrift
from mjbench.status import Status

# Asks new processes, of the baseline and the candidate, for what a launch needs, without waiting.
Equip = Callable[[Sequence[WorkerProcess]], None]


@dataclass(frozen=True)
class WorkCheck:
    """Whether both targets do the same work.

    Attributes:
      drift: how far qpos, qvel and act differ; None where the models differ in size.
      diverged: simulations that diverged in the baseline, and in the candidate; none of those is
        timed.
      warnings: how many other simulations raised each warning, in the baseline, and in the
        candidate.
      candidate_starts: where those of the candidate came from; None where both start alike.
    """

    baseline: Work
    candidate: Work
    drift: StateDrift | None
    diverged: tuple[int, int]
    warnings: tuple[Mapping[str, int], Mapping[str, int]]
    nbatch: int
    nstep: int
    starts: Starts
    candidate_starts: Starts | None = None
    timesteps_s: tuple[float, float] = (1.0, 1.0)

    @property
    def log_scale(self) -> float:
        """What to add to the log ratio of a step's time for that of a simulated second's."""
        return math.log(self.timesteps_s[0] / self.timesteps_s[1])

    @property
    def changes(self) -> list[str]:
        """How the work changed, in a few words each; empty where it is the same."""
        one_step = self.drift.one_step if self.drift else None
        return changed_work.work_changes(self.baseline, self.candidate, one_step, self.diverged)

    @property
    def changed(self) -> bool:
        return bool(self.changes)


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
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        placements: Iterator[PlacementPair] | None = None,
    ):
        """Start the processes of the first launch; `equip` tells all of them what they need."""
        self._pool, self._releases, self._names = pool, releases, names
        self._placements = placements or itertools.repeat(AS_SHIPPED)
        self._seeds = pool.seeds(releases)
        self._next_seeds = next(self._seeds)
        self._equip: Equip | None = None
        # Those that were started ahead, for the next launch.
        self._next: ProcessPair | None = None
        # Those whose launches are over, and which are ended while the next ones start.
        self._finished: list[ProcessPair] = []
        self._failure: MjbenchError | None = None
        try:
            self._start_ahead(cores.USABLE)
        except BaseException:
            self.close()
            raise

    def equip(self, equip: Equip) -> None:
        """Have the processes of every launch asked for what they need, the next one's now."""
        self._equip = equip
        if self._next is not None:
            equip(self._next.processes)

    def wait(self) -> None:
        """Wait until the processes of the next launch are ready."""
        try:
            if self._failure is not None:
                raise self._failure
            next_pair = self._start_ahead(cores.USABLE)
            for process, release in zip(next_pair.processes, self._releases, strict=True):
                self._pool.wait_for(process, release)
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def launch(self, core: int | None) -> Iterator[ProcessPair]:
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

    def close(self) -> None:
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
            for i in random.sample((0, 1), 2):  # neither of the two is always the first
                started[i] = self._pool.start(
                    self._releases[i], self._names[i], both[i], i, allowed, seeds
                )
            pair = ProcessPair((started[0], started[1]), placements)
            if self._equip is not None:
                self._equip(pair.processes)
            if self._next_seeds.program != seeds.program:
                for i in random.sample((0, 1), 2):
                    release = self._releases[i]
                    self._pool.start_program_early(release, i, allowed, self._next_seeds)
        except BaseException:
            self._pool.end(list(started.values()))
            raise
        self._next = pair
        return pair


class PairWork(ABC):
    """What the two processes of each launch do, as often as it takes.

    Attributes:
      nthread: threads or processes that the work takes; with one, launches run on one core.
      nsection: sections of a run, which blocks time one after the other (see `loop_sections`).
      work_check: whether both sides do the same work; of steps only.
      results: how what both compute compares; of operations only.
      baseline_workload: file of the baseline's `PortableWorkload`, final states included, which
        lasts as long as the pool; of steps only.
    """

    nthread: int = 1
    nsection: int = 1
    work_check: WorkCheck | None = None
    results: ResultsCheck | None = None
    baseline_workload: Path | None = None

    def __init__(self, metric: Metric):
        self._metric = metric
        self._is_read_once = METRICS[metric].is_read_once

    def equip(self, processes: Sequence[WorkerProcess]) -> None:  # noqa: B027
        """Have the processes of a launch read what they need, without waiting."""

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """Lay out memory anew; return the nanoseconds of one block of each section, of both.

        Args:
          is_new_run: whether a run that is divided may be another one than in the layout before.
        """
        allowed = cores.usable(pair.core)
        ns = {i: self._prepare(pair.processes[i], i, allowed) for i in random.sample((0, 1), 2)}
        return ns[0], ns[1]

    @abstractmethod
    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        """Have a process ready to time blocks; return the nanoseconds of one of each section.

        It runs on the cores `allowed` from now on; none for no change.
        """

    def compilations(self, pair: ProcessPair) -> Pair[Compilation] | None:
        return None

    def layout_counts(self, all_blocks_s: float) -> tuple[int, int]:
        """Return how often a launch lays memory out, at least, and while the next launch starts.

        Args:
          all_blocks_s: see `time_limit.quad_count`.
        """
        if self._is_read_once:
            return 1, 1
        return layout_count(all_blocks_s, self.nsection), MAX_LAYOUTS

    def quad_count(self, all_blocks_s: float) -> int:
        return 1 if self._is_read_once else quad_count(all_blocks_s, self.nsection)

    def launch_s(self, all_blocks_s: float) -> float:
        return all_blocks_s if self._is_read_once else launch_s(all_blocks_s, self.nsection)

    def close(self) -> None:  # noqa: B027
        """Remove what is no longer needed."""


class LaunchedPair(ABC):
    """Two sides, which can be launched as often as it takes once they are prepared.

    Used as a context manager, it notes what ends the block before its end, unless that is a fault
    of the program: what was measured until then stays.

    Attributes:
      launches: all until now.
      ending: how the block ended: `OK` also where time ran out, with a line where it ran out before
        there were enough launches.
    """

    def __init__(
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        time_limit: TimeLimit,
    ):
        """Start nothing yet, nor the time limit, which starts with the work."""
        self._pool, self._releases, self._names = pool, releases, names
        self.time_limit = time_limit
        self.launches: list[LaunchRow] = []
        self.ending = Failure(Status.OK, "")
        self.work: PairWork | None = None
        self._counting: WorkerProcess | None = None
        self._before_s = 0.0  # of the time limit, spent before the first launch
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> bool:
        try:
            self.close()
        except KeyboardInterrupt as interrupt:
            if error is None or isinstance(error, ENDING_ERRORS):  # not a fault of the program
                error = interrupt
        except ENDING_ERRORS as failure:
            error = error or failure  # what ended the block comes first
        if isinstance(error, ENDING_ERRORS):
            self.ending = ending_of(error)
            return True
        return False

    @abstractmethod
    def _new_work(self) -> PairWork:
        """Return what both do, and start the time limit."""

    def prepare(self, placements: Iterator[PlacementPair] | None = None) -> None:
        """Make sure that both sides can do the work.

        Args:
          placements: of the releases' libraries, launch by launch; None for as shipped.

        Raises:
          InputError: one of them cannot.
          MachineError: a process crashed, hung or failed.
          OutOfTimeError: the time limit does not allow one launch.
        """
        # those of the first launch import MuJoCo while the work is prepared
        placements = placements or itertools.repeat(AS_SHIPPED)
        self._pairs = ProcessPairs(self._pool, self._releases, self._names, placements)
        self._closing.callback(self._pairs.close)
        self.work = self._new_work()
        self._closing.callback(self.work.close)
        self._pairs.equip(self.work.equip)

    def launch(self) -> LaunchRow:
        """Measure both once, in fresh processes, on a free core; raise what `prepare` does."""
        if not self.launches:
            self._before_s = self.time_limit.spent_s()
        launch = self._launch()
        self.launches.append(launch)
        return launch

    def has_time(self, has_answer: bool) -> bool:
        """Return whether another launch fits the time limit; the first one always does.

        Args:
          has_answer: whether the launches until now are not for nothing if there is no other.

        Raises:
          OutOfTimeError: it does not fit, and they are.
        """
        count = len(self.launches)
        return count == 0 or self.time_limit.allows_another(count, self._before_s, has_answer)

    def _launch(self) -> LaunchRow:
        assert self.work is not None, "it was prepared"
        self._pairs.wait()
        # work with threads gets all cores, so nothing may start on one of them meanwhile
        threaded = self.work.nthread > 1
        had = self._cores_had(self.work.nthread) if threaded else None
        with self._pairs.launch(None if threaded else cores.freest_core()) as pair:
            launch = self._measure(pair, self.work)
            return replace(launch, cores=had, compilations=self.work.compilations(pair))

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
            if not self.launches and not layouts:  # steps may be heavier than those at the start
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
        """End processes and remove files that are left."""
        self._closing.close()


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
