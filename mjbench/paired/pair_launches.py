"""Two sides, timed in alternating blocks in fresh processes: the engine of paired comparisons.

A launch starts one program for each side anew. Both run on one core, with this process,
and take turns in quads, ABBA or BAAB at random (A is the baseline), so that drift and the
order of turns hit both alike; a few times per launch both lay out their memory anew. The quads of
a layout take the sections of the launch's run in turn. Where a block is the whole run, each layout
draws simulations anew. A launch yields one number, the log ratio of all that was timed. Launches
are the samples that `verdict` judges, as many as the verdict needs. While one launch is measured,
the programs of the next start on the other cores.

What the sides do in a launch is a `PairWork`: steps, or an operation around them (of functions, see
`function_verdict`).
"""

import contextlib
import functools
import itertools
import math
import random
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from mjbench.errors import Failure, InputError
from mjbench.measuring import timing
from mjbench.measuring.calls import Compilation
from mjbench.paired import cores, memory_blocks, operations, preparation
from mjbench.paired.call_results import Leaf, ResultsCheck, compare
from mjbench.paired.memory_blocks import GROWTH_NSTEP
from mjbench.paired.metrics import METRICS, Measured, Metric
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.records import LaunchRow, Pair
from mjbench.paired.run_sizes import RUN_S, Sizes
from mjbench.paired.targets import Target
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
from mjbench.paired.worker_answers import ReadyOperation
from mjbench.paired.worker_pool import ProcessPair, ProcessPairs, WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

# How often a block does an operation, at most.
MAX_REPEATS = 10_000
# Metrics of which a launch has one layout and one quad, because more would be the same again; and
# how many blocks of each side take time: that of the layout, and those of a quad that do more than
# read what was measured.
_BLOCKS_OF_ONE_QUAD: Mapping[Metric, int] = {
    Metric.MEMORY: 1,
    Metric.GROWTH: 3,
    Metric.ARENA: 1,
    Metric.COMPILE: 1,
}


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
        self._nblock = _BLOCKS_OF_ONE_QUAD.get(metric)

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
        if self._nblock is not None:
            return 1, 1
        return layout_count(all_blocks_s, self.nsection), MAX_LAYOUTS

    def quad_count(self, all_blocks_s: float) -> int:
        return 1 if self._nblock is not None else quad_count(all_blocks_s, self.nsection)

    def launch_s(self, all_blocks_s: float) -> float:
        if self._nblock is not None:
            return self._nblock * all_blocks_s
        return launch_s(all_blocks_s, self.nsection)

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


class TargetPair(LaunchedPair):
    """Two targets; files are removed at the end, but the baseline's workload."""

    def __init__(
        self,
        pool: WorkerPool,
        baseline: Target,
        candidate: Target,
        sizes: Sizes | None = None,
        time_limit: TimeLimit | None = None,
    ):
        self._targets, self._sizes = (baseline, candidate), sizes or Sizes()
        releases, names = (baseline.release, candidate.release), preparation.describe(self._targets)
        super().__init__(pool, releases, names, time_limit or TimeLimit())

    def _new_work(self) -> PairWork:
        metric = self._sizes.metric
        if METRICS[metric].measured == Measured.OPERATION:
            return OperationWork(self._pool, self._targets, metric, self.time_limit)
        return StepWork(self._pool, self._targets, self._sizes, self.time_limit)


class StepWork(PairWork):
    """The simulations that two targets step, as often as it takes."""

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        sizes: Sizes,
        time_limit: TimeLimit,
        roles: tuple[str, str] = preparation.ROLES,
    ):
        """Load the models, and make sure that both targets can do it; see `preparation.prepare`."""
        super().__init__(sizes.metric)
        self._targets, self._sizes = targets, sizes
        self.nthread = max(target.nthread for target in targets)
        self.prepared = preparation.prepare(pool, targets, sizes, time_limit, roles)
        self.nsection, self.work_check = self.prepared.nsection, self.prepared.work_check
        self.baseline_workload = self.prepared.workloads[0]
        # Simulations may differ in how much slower they are, so they are timed equally often.
        self._times_drawn = [0] * self.prepared.nsim
        self._drawn: list[int] = []
        if sizes.metric == Metric.GROWTH:
            both_s = 2 * GROWTH_NSTEP * self.prepared.step_s
            check_growth(both_s, pool)
            time_limit.check_first_launch(self.launch_s(both_s))

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        if self._metric == Metric.MEMORY:  # all that a process loads is part of its peak
            return
        prepared = self.prepared
        for process, target, model, workload in zip(
            processes, self._targets, prepared.models, prepared.workloads, strict=True
        ):
            process.ask(Worker.equip, model, workload, target.path)

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        if is_new_run or self.nsection == 1:
            nbatch = self.prepared.work_check.nbatch
            self._drawn = draw_least(self._times_drawn, nbatch)
        return super().lay_out(pair)

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        target, workload = self._targets[i], self.prepared.workloads[i]
        match self._metric:
            case Metric.MEMORY:
                options = dict(target.model_options)
                file = target.model.path
                return process.call(memory_blocks.prepare_peak, file, options, workload)
            case Metric.GROWTH:
                return process.call(memory_blocks.prepare_growth, allowed)
            case Metric.ARENA:
                return process.call(memory_blocks.prepare_arena)
        return process.call(
            Worker.prepare,
            target.path,
            dict(target.options),
            allowed,
            self._drawn,
            callback=target.callback,
            slowdown=target.slowdown,
            has_timer=target.has_timer,
            returns=self._sizes.returns,
            metric=self._metric,
            nsection=self.nsection,
        )

    def close(self) -> None:
        """Remove all files but the baseline's workload."""
        for file in (*self.prepared.models, self.prepared.workloads[1]):
            file.unlink(missing_ok=True)


class OperationWork(PairWork):
    """An operation around the step, on the models of two targets (see `operations`)."""

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        metric: Metric,
        time_limit: TimeLimit,
    ):
        """Load the models, and choose how often a block does it."""
        super().__init__(metric)
        with preparation.loaded(pool, targets, time_limit) as (processes, models):
            self._models = models
            is_of_source = metric == Metric.LOAD
            self._files = [target.model.path for target in targets] if is_of_source else [*models]
            once = [self._ready(process, i, (), 1) for i, process in enumerate(processes)]
            slower_s = 1e-9 * max(each.ns for each in once)
            self._repeats = min(max(1, round(RUN_S / slower_s)), MAX_REPEATS)
            time_limit.check_first_launch(self.launch_s(1e-9 * sum(each.ns for each in once)))
            timed = [
                self._ready(process, i, (), self._repeats) for i, process in enumerate(processes)
            ]
        old, new = ([[Leaf("", each.result)]] for each in timed)
        self.results = compare(old, new)

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return self._ready(process, i, allowed, self._repeats).ns

    def close(self) -> None:
        for file in self._models:
            file.unlink(missing_ok=True)

    def _ready(
        self, process: WorkerProcess, i: int, allowed: Sequence[int], repeats: int
    ) -> ReadyOperation:
        source = ModelSource("", self._files[i])
        prepare = functools.partial(operations.OF_METRIC[self._metric], source, repeats)
        return process.call(Worker.prepare_operation, prepare, allowed)


def check_growth(both_s: float, pool: WorkerPool) -> None:
    """Refuse blocks of growth in which a process may count as hung; `both_s` is of both sides."""
    if both_s > pool.limit_s:
        raise InputError(
            f"--metric growth needs {GROWTH_NSTEP:,} steps or calls in a block, which would take"
            f" {both_s:.0f} s here: give it a smaller model, or a function that does less"
        )


def draw_least(times_drawn: list[int], count: int) -> list[int]:
    """Return indices that were drawn least often, ties at random; count them as drawn."""
    order = sorted(range(len(times_drawn)), key=lambda i: (times_drawn[i], random.random()))
    for i in order[:count]:
        times_drawn[i] += 1
    return order[:count]
