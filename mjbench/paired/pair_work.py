"""What the two processes of a launch do, as often as it takes: steps, or an operation."""

import random
from abc import ABC, abstractmethod
from collections.abc import Sequence

from mjbench.paired import cores, preparation
from mjbench.paired.call_results import Leaf, compare
from mjbench.paired.memory_blocks import prepare_growth, prepare_peak
from mjbench.paired.outcomes import Metric
from mjbench.paired.process_pairs import ProcessPair
from mjbench.paired.run_sizes import RUN_S, Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit, launch_s
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import ReadyOperation
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess

# How often a block does an operation, at most.
MAX_REPEATS = 10_000
# Steps of a block whose growth is measured: those of so many runs, which take about a millisecond,
# no fewer and no more than these.
GROWTH_RUNS, MIN_GROWTH_STEPS, GROWTH_STEPS = 200, 100, 5000


class PairWork(ABC):
    """What the two processes of each launch do, as often as it takes.

    Attributes:
      nthread: threads or processes that the work takes; with one, launches run on one core.
      nsection: sections of a run, which blocks time one after the other (see `loop_sections`).
      is_repeated: whether a launch lays memory out and does it as often as fits its time; one
        layout and one quad otherwise.
    """

    nthread: int = 1
    nsection: int = 1
    is_repeated: bool = True

    @abstractmethod
    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """Have the processes of a launch read what they need, without waiting."""

    @abstractmethod
    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """Lay out memory anew; return the nanoseconds of one block of each section, of both.

        Args:
          is_new_run: whether a run that is divided may be another one than in the layout before.

        Raises:
          InputError: a process cannot do it.
          ChildError: a process crashed, hung or failed.
        """

    def close(self) -> None:  # noqa: B027
        """Remove what is no longer needed."""


class StepWork(PairWork):
    """The simulations that two targets step, as often as it takes.

    Attributes:
      workloads: files of the `PortableWorkload`s, final states included.
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
        ns = {}
        for i in random.sample((0, 1), 2):
            target = self._targets[i]
            ns[i] = pair.processes[i].call(
                Worker.prepare,
                target.path,
                dict(target.options),
                cores.usable(pair.core),
                self._drawn,
                callback=target.callback,
                slowdown=target.slowdown,
                has_timer=target.has_timer,
                returns=self._sizes.returns,
                metric=self._sizes.metric,
                nsection=self.nsection,
            )
        return ns[0], ns[1]

    def close(self) -> None:
        """Remove all files but the baseline's workload."""
        for file in (*self._models, self.workloads[1]):
            file.unlink(missing_ok=True)


class MemoryWork(StepWork):
    """What the processes of two targets take up: all of it at its peak, or what steps add."""

    is_repeated = False

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """See `PairWork.equip`: a peak has to be of all that a process loads."""
        if self._sizes.metric == Metric.GROWTH:
            super().equip(processes)

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """See `PairWork.lay_out`."""
        ns = {i: self._prepare(pair.processes[i], i) for i in random.sample((0, 1), 2)}
        return ns[0], ns[1]

    def _prepare(self, process: WorkerProcess, i: int) -> int:
        if self._sizes.metric == Metric.GROWTH:
            nstep = growth_nstep(self.work_check.nbatch * self.work_check.nstep)
            return process.call(prepare_growth, nstep)
        target = self._targets[i]
        options, workload = dict(target.model_options), self.workloads[i]
        return process.call(prepare_peak, target.model.path, options, workload)


class OperationWork(PairWork):
    """An operation around the step, on the models of two targets (see `operations`).

    Attributes:
      results: how what it computes compares.
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
        time_limit.check_first_launch(launch_s(1e-9 * sum(each.ns for each in once)))
        old, new = ([[Leaf("", each.result)]] for each in once)
        self.results = compare(old, new)

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """See `PairWork.equip`: there is nothing to read."""

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        """See `PairWork.lay_out`."""
        allowed = cores.usable(pair.core)
        ns = {
            i: self._ready(pair.processes[i], i, allowed, self._repeats).ns
            for i in random.sample((0, 1), 2)
        }
        return ns[0], ns[1]

    def close(self) -> None:
        """See `PairWork.close`."""
        for file in self._models:
            file.unlink(missing_ok=True)

    def _ready(
        self, process: WorkerProcess, i: int, allowed: Sequence[int], repeats: int
    ) -> ReadyOperation:
        name, file = self._metric.value, self._files[i]
        return process.call(Worker.prepare_operation, name, file, allowed, repeats)


def growth_nstep(run_nstep: int) -> int:
    """Return how many steps a block of growth has, from those of a run."""
    return min(max(GROWTH_RUNS * run_nstep, MIN_GROWTH_STEPS), GROWTH_STEPS)


def draw_least(times_drawn: list[int], count: int) -> list[int]:
    """Return indices that were drawn least often, ties at random; count them as drawn."""
    order = sorted(range(len(times_drawn)), key=lambda i: (times_drawn[i], random.random()))
    for i in order[:count]:
        times_drawn[i] += 1
    return order[:count]
