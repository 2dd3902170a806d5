"""What the two processes of a launch do, as often as it takes: steps, or an operation."""

import functools
import random
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from mjbench.errors import InputError
from mjbench.measuring.calls import Compilation
from mjbench.paired import cores, memory_blocks, operations, preparation
from mjbench.paired.call_results import Leaf, compare
from mjbench.paired.memory_blocks import GROWTH_NSTEP
from mjbench.paired.outcomes import Metric
from mjbench.paired.process_pairs import ProcessPair
from mjbench.paired.records import Pair
from mjbench.paired.run_sizes import RUN_S, Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import (
    MAX_LAYOUTS,
    TimeLimit,
    launch_s,
    layout_count,
    quad_count,
)
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import ReadyOperation
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.simulation.models import ModelSource

# How often a block does an operation, at most.
MAX_REPEATS = 10_000


class PairWork(ABC):
    """What the two processes of each launch do, as often as it takes.

    Attributes:
      nthread: threads or processes that the work takes; with one, launches run on one core.
      nsection: sections of a run, which blocks time one after the other (see `loop_sections`).
    """

    nthread: int = 1
    nsection: int = 1

    @abstractmethod
    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """Have the processes of a launch read what they need, without waiting."""

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """Lay out memory anew; return the nanoseconds of one block of each section, of both.

        Args:
          is_new_run: whether a run that is divided may be another one than in the layout before.

        Raises:
          InputError: a process cannot do it.
          ChildError: a process crashed, hung or failed.
        """
        allowed = cores.usable(pair.core)
        ns = {i: self._prepare(pair.processes[i], i, allowed) for i in random.sample((0, 1), 2)}
        return ns[0], ns[1]

    @abstractmethod
    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        """Have a process ready to time blocks; return the nanoseconds of one of each section.

        Args:
          i: 0 for the baseline, 1 for the candidate.
          allowed: cores to run on from now on; empty for no change.
        """

    def compilations(self, pair: ProcessPair) -> Pair[Compilation] | None:
        """Return what compiling took in both processes of a launch; None without any."""
        return None

    def layout_counts(self, all_blocks_s: float) -> tuple[int, int]:
        """Return how often a launch lays memory out, at least, and while the next launch starts.

        Args:
          all_blocks_s: see `time_limit.quad_count`.
        """
        return layout_count(all_blocks_s, self.nsection), MAX_LAYOUTS

    def quad_count(self, all_blocks_s: float) -> int:
        """Return the number of quads of a layout; see `layout_counts` for the argument."""
        return quad_count(all_blocks_s, self.nsection)

    def launch_s(self, all_blocks_s: float) -> float:
        """Return about how long a launch takes; see `layout_counts` for the argument."""
        return launch_s(all_blocks_s, self.nsection)

    def close(self) -> None:  # noqa: B027
        """Remove what is no longer needed."""


class SingleQuadWork(PairWork):
    """What each launch does in one layout and one quad, because more would be the same again.

    Class attributes:
      nblock: how many blocks of each side take time: that of the layout, and those of the quad.
    """

    nblock = 3

    def layout_counts(self, all_blocks_s: float) -> tuple[int, int]:
        """See `PairWork.layout_counts`."""
        return 1, 1

    def quad_count(self, all_blocks_s: float) -> int:
        """See `PairWork.quad_count`."""
        return 1

    def launch_s(self, all_blocks_s: float) -> float:
        """See `PairWork.launch_s`."""
        return self.nblock * all_blocks_s


class StepWork(PairWork):
    """The simulations that two targets step, as often as it takes.

    Attributes:
      workloads: files of the `PortableWorkload`s, final states included.
      step_s: see `Preparation.step_s`.
    """

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        sizes: Sizes,
        time_limit: TimeLimit,
        roles: tuple[str, str] = preparation.ROLES,
    ):
        """Load the models, and make sure that both targets can do it; see `preparation.prepare`."""
        self._targets, self._sizes = targets, sizes
        self.nthread = max(target.nthread for target in targets)
        prepared = preparation.prepare(pool, targets, sizes, time_limit, roles)
        self.nsection, self.work_check = prepared.nsection, prepared.work_check
        self.workloads, self._models = prepared.workloads, prepared.models
        self.step_s = prepared.step_s
        # Simulations may differ in how much slower they are, so they are timed equally often.
        self._times_drawn = [0] * prepared.nsim
        self._drawn: list[int] = []

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """Have the processes of a launch read model and workload, without waiting."""
        for process, target, model, workload in zip(
            processes, self._targets, self._models, self.workloads, strict=True
        ):
            process.ask(Worker.equip, model, workload, target.path)

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """See `PairWork.lay_out`."""
        if is_new_run or self.nsection == 1:
            self._drawn = draw_least(self._times_drawn, self.work_check.nbatch)
        return super().lay_out(pair)

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        target = self._targets[i]
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
            metric=self._sizes.metric,
            nsection=self.nsection,
        )

    def close(self) -> None:
        """Remove all files but the baseline's workload."""
        for file in (*self._models, self.workloads[1]):
            file.unlink(missing_ok=True)


class PeakWork(SingleQuadWork, StepWork):
    """The most memory that the processes of two targets have, and all that they load is part of it.

    The blocks of its quads only read it.
    """

    nblock = 1

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """See `PairWork.equip`: there is nothing to read ahead."""

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        target, workload = self._targets[i], self.workloads[i]
        options = dict(target.model_options)
        return process.call(memory_blocks.prepare_peak, target.model.path, options, workload)


class GrowthWork(SingleQuadWork, StepWork):
    """What steps of two targets add to the memory of their processes."""

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        sizes: Sizes,
        time_limit: TimeLimit,
    ):
        """Prepare it as `StepWork` does; raises OutOfTimeError where the limit allows no launch."""
        super().__init__(pool, targets, sizes, time_limit)
        both_s = 2 * GROWTH_NSTEP * self.step_s
        check_growth(both_s, pool)
        time_limit.check_first_launch(self.launch_s(both_s))

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return process.call(memory_blocks.prepare_growth, allowed)


class ArenaWork(SingleQuadWork, StepWork):
    """The most that the arenas of two targets hold; the blocks of its quads only read it."""

    nblock = 1

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return process.call(memory_blocks.prepare_arena)


# What does the work of metrics that need more than runs of steps.
STEP_WORK: Mapping[Metric, type[StepWork]] = {
    Metric.MEMORY: PeakWork,
    Metric.GROWTH: GrowthWork,
    Metric.ARENA: ArenaWork,
}


class OperationWork(PairWork):
    """An operation around the step, on the models of two targets (see `operations`).

    Attributes:
      results: how what a block of it computes compares.
    """

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        metric: Metric,
        time_limit: TimeLimit,
    ):
        """Load the models, and choose how often a block does it.

        Raises:
          InputError: a target cannot do it.
          ChildError: a target crashed, hung or failed.
          OutOfTimeError: the limit does not allow a launch.
        """
        self._metric = metric
        with preparation.loaded(pool, targets, time_limit) as (processes, models):
            self._models = models
            if metric == Metric.LOAD:  # from the user's file
                self._files = [target.model.path for target in targets]
            else:
                self._files = [*models]
            once = [self._ready(process, i, (), 1) for i, process in enumerate(processes)]
            slower_s = 1e-9 * max(each.ns for each in once)
            self._repeats = min(max(1, round(RUN_S / slower_s)), MAX_REPEATS)
            time_limit.check_first_launch(self.launch_s(1e-9 * sum(each.ns for each in once)))
            timed = [
                self._ready(process, i, (), self._repeats) for i, process in enumerate(processes)
            ]
        old, new = ([[Leaf("", each.result)]] for each in timed)
        self.results = compare(old, new)

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """See `PairWork.equip`: there is nothing to read."""

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return self._ready(process, i, allowed, self._repeats).ns

    def close(self) -> None:
        """See `PairWork.close`."""
        for file in self._models:
            file.unlink(missing_ok=True)

    def _ready(
        self, process: WorkerProcess, i: int, allowed: Sequence[int], repeats: int
    ) -> ReadyOperation:
        source = ModelSource("", self._files[i])
        prepare = functools.partial(operations.OF_METRIC[self._metric], source, repeats)
        return process.call(Worker.prepare_operation, prepare, allowed)


def check_growth(both_s: float, pool: WorkerPool) -> None:
    """Refuse blocks of growth in which a process may count as hung.

    Args:
      both_s: about how many seconds a block takes, of both sides together.

    Raises:
      InputError: the steps or calls are too slow.
    """
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
