"""Measure a release against the reference, as the history needs it: steps and operations.

Unlike a verdict, which ends when it is certain, a ratio ends when it is known well enough, whatever
it is: so none is biased by when it ended.
"""

import functools
import math
import random
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from benchmarks.history import release_ratios
from benchmarks.history.release_ratios import LaunchRatio, RatioRecord
from benchmarks.history.tasks import ReleaseTask, Selection
from mjbench.errors import Failure, InputError, MachineError, failure_of
from mjbench.measuring import stats
from mjbench.measuring.timing import Progress
from mjbench.paired import cores, moved_check
from mjbench.paired.launches import StopRule, Targets
from mjbench.paired.launches import launch as launch_until_enough
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.pair_launches import ProcessPair, ProcessPairs, time_quads
from mjbench.paired.records import section_numbers
from mjbench.paired.time_limit import ending_of, quad_count
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status

# How often a launch lays out the memory of a task anew, and seconds of blocks in each layout: less
# than in a verdict. Many short launches are better than a few long ones: the time of some models
# differs more between launches than within one, and the processes of the next start meanwhile.
_LAYOUTS, _LAYOUT_S = 2, 0.033
# Releases that are measured in turns, at most: their workloads are stored meanwhile.
_MAX_IN_TURNS = 8
# A task that is alone is timed in more layouts until the processes of the next launch are ready, up
# to this number.
_MAX_LAYOUTS = 6


def measure(
    pool: WorkerPool, tasks: Sequence[ReleaseTask], launches: int | None = None
) -> list[RatioRecord]:
    """Compare a release with the reference in each of the tasks; see `measure_each`."""
    (records,) = measure_each(pool, [tasks], launches=launches)
    return records


def measure_each(
    pool: WorkerPool,
    releases: Sequence[Sequence[ReleaseTask]],
    on_launch: Callable[[int, float], None] = lambda index, share: None,
    clock: Callable[[], float] = time.monotonic,
    launches: int | None = None,
) -> Iterator[list[RatioRecord]]:
    """Compare releases with the reference, up to eight of them in turns.

    What disturbs launches for half a minute then does not decide the ratio of one release. Where a
    release crashes, hangs or fails in a task, or Ctrl-C is pressed, the records say so, and hold
    what was measured until then.

    Args:
      on_launch: called after each launch, with the index of the release and the share of its
        launches that is done, at least.
      launches: of each release; None for as many as `release_ratios.are_enough` asks for.

    Yields:
      The records of a release once it is complete, one for each of its tasks, in their order. After
      Ctrl-C, those of all that are measured in turns with it, and none of the others.
    """
    measurements = [
        _Measurement(pool, tasks, functools.partial(on_launch, index), clock, launches)
        for index, tasks in enumerate(releases)
    ]
    groups = math.ceil(len(measurements) / _MAX_IN_TURNS) or 1
    size = math.ceil(len(measurements) / groups) or 1
    for begin in range(0, len(measurements), size):
        group = measurements[begin : begin + size]
        yield from _measure_in_turns(group)
        if any(each.is_interrupted for each in group):
            return


def measure_rest(
    pool: WorkerPool, selection: Selection, earlier: Sequence[object], on_progress: Progress
) -> Iterator[list[RatioRecord]]:
    """Compare selected releases with the reference in what earlier records do not have."""
    done = {(r.record_type, r.build, r.series) for r in release_ratios.finished(earlier)}
    by_release = [
        [
            task
            for task in selection.tasks(release)
            if (task.record_type, release.key, task.series) not in done
        ]
        for release in selection.releases
    ]
    remaining = [tasks for tasks in by_release if tasks]
    shares = [0.0] * len(remaining)

    def on_launch(index: int, share: float) -> None:
        shares[index] = share
        _, release = remaining[index][0].releases
        on_progress(f"MuJoCo {release.version}", sum(shares) / len(remaining))

    yield from measure_each(pool, remaining, on_launch)


def _measure_in_turns(group: Sequence["_Measurement"]) -> Iterator[list[RatioRecord]]:
    launches = release_ratios.SCHEDULE_LAUNCHES if len(group) > 1 else None
    remaining = list(group)
    try:
        while remaining:
            for each in random.sample(remaining, len(remaining)):
                each.take_turn(launches)
                if not each.remaining():
                    remaining.remove(each)
                    each.remove_files()
                    yield each.records()
                if each.is_interrupted:
                    for other in remaining:
                        other.fail(ending_of(KeyboardInterrupt()))
                    yield from (other.records() for other in remaining)
                    if not remaining:  # no record says it
                        raise KeyboardInterrupt
                    return
    finally:
        for each in group:
            each.remove_files()


class _Measurement(Targets[float], StopRule[float]):
    """One release, which is measured in one turn or several.

    It times its tasks in pairs of processes, until they are known well enough or others have their
    turn; a launch gives the seconds that it took.
    """

    def __init__(
        self,
        pool: WorkerPool,
        tasks: Sequence[ReleaseTask],
        on_launch: Callable[[float], None],
        clock: Callable[[], float],
        launches: int | None,
    ):
        self._pool, self._tasks, self._clock = pool, tasks, clock
        self._on_launch, self._fixed = on_launch, launches
        self._placement: PlacementControl | None = None
        self._pairs: ProcessPairs | None = None
        self._count, self._launches_s = 0, 0.0  # of all turns
        self._turns_s = 0.0  # with all that belongs to launches
        self._last: int | None = None  # launch of this turn
        self.is_interrupted = False

    def take_turn(self, launches: int | None) -> None:
        """Launch until all tasks are known well enough; `launches` times at most, if given."""
        begin_s = self._clock()
        self._last = None if launches is None else self._count + launches
        ending = launch_until_enough(self, self)
        self.is_interrupted = ending.status == Status.INTERRUPTED  # and so are the others
        if ending.status not in (Status.OK, Status.INTERRUPTED):
            self.fail(ending)
        self._turns_s += self._clock() - begin_s

    def fail(self, failure: Failure) -> None:
        """Note why tasks that need more launches have none."""
        for position in self.remaining():
            self._tasks[position].failure = failure

    def records(self) -> list[RatioRecord]:
        problem = self._placement.problem if self._placement else ""
        seconds = self._turns_s / len(self._tasks)
        return [task.record(problem, seconds) for task in self._tasks]

    def remove_files(self) -> None:
        for task in self._tasks:
            task.close()

    def remaining(self) -> list[int]:
        """Return the positions of the tasks that need more launches, and can have them."""
        return [
            position
            for position, task in enumerate(self._tasks)
            if not task.is_complete and task.failure is None
        ]

    def prepare(self) -> None:
        """Begin a turn; in the first, prepare all tasks."""
        reference, release = self._tasks[0].releases
        is_first = self._placement is None
        if self._placement is None:
            self._placement = moved_check.placement_control(self._pool, reference, release)
        names = f"reference (MuJoCo {reference.version})", f"release (MuJoCo {release.version})"
        self._pairs = ProcessPairs(self._pool, (reference, release), names)
        self._pairs.start(self._placement.placements())
        if not is_first:
            return
        for task in self._tasks:
            try:
                task.prepare(self._pool)
            except (InputError, MachineError) as error:
                task.failure = failure_of(error)

    def launch(self, positions: Sequence[int]) -> float:
        """Time tasks once; one that fails says how, and ends the launch if its process may have."""
        assert self._pairs is not None, "it was prepared"
        begin_s = self._clock()
        _launch_once([self._tasks[position] for position in positions], self._pairs)
        return self._clock() - begin_s

    def close(self) -> None:
        if self._pairs is not None:
            self._pairs.end_all()

    def next_targets(self) -> Sequence[int]:
        return () if self._count == self._last else self.remaining()

    def add(self, launch: float) -> None:
        self._count += 1
        self._launches_s += launch
        for position in self.remaining():
            task = self._tasks[position]
            if self._fixed is not None:
                task.is_complete = len(task.launches) >= self._fixed
            else:
                task.is_complete = release_ratios.are_enough(task.launches, self._launches_s)
        share = release_ratios.completed_share(self._count, self._launches_s)
        self._on_launch(share if self.remaining() else 1.0)


def _launch_once(tasks: Sequence[ReleaseTask], pairs: ProcessPairs) -> None:
    pairs.wait()
    is_enough = pairs.is_next_ready if len(tasks) == 1 else lambda: True
    with pairs.launched(cores.freest_core()) as pair:
        for task in random.sample(tasks, len(tasks)):
            try:
                log_ratio, reference_ns = _time(task, pair, is_enough)
            except (InputError, MachineError) as error:
                task.failure = failure_of(error)
                if isinstance(error, MachineError):
                    return
            else:
                task.add(LaunchRatio(log_ratio, pair.placements.new), reference_ns)


def _time(
    task: ReleaseTask, pair: ProcessPair, is_enough: Callable[[], bool]
) -> tuple[float, float]:
    """Time a task in a few layouts of memory, each with fewer quads than a verdict's.

    Returns:
      The log ratio of all that was timed, and the nanoseconds that the reference takes for all
      sections of a run: the sum of their medians; of several runs, the median.
    """
    orders: list[str] = []
    ns: list[np.ndarray] = []
    task.equip(pair.processes)
    while len(ns) < _LAYOUTS or (len(ns) < _MAX_LAYOUTS and not is_enough()):
        task.all_blocks_s = min(task.all_blocks_s, 1e-9 * sum(task.lay_out(pair)))
        count = quad_count(task.all_blocks_s, task.nsection, _LAYOUT_S)
        # the first quad warms up both: what was prepared last would have the advantage in it
        layout_orders, layout_ns = time_quads(*pair.processes, count + 1)
        orders += layout_orders[1:]
        ns.append(layout_ns[1:])
    # each layout draws simulations anew
    parts = section_numbers([len(each) for each in ns], range(len(ns)), task.nsection)
    blocks = np.concatenate(ns)
    log_ratio = stats.total_log_ratio(orders, blocks, parts)
    return log_ratio, run_ns(orders, blocks, parts, task.nsection)


def run_ns(orders: Sequence[str], ns: np.ndarray, parts: np.ndarray, nsection: int) -> float:
    """Return the nanoseconds of a run of the baseline; see `records.section_numbers`."""
    blocks, _ = stats.blocks_by_target(orders, ns)
    medians = [np.median(blocks[parts == part]) for part in np.unique(parts)]
    return float(np.median(np.reshape(medians, (-1, nsection)).sum(axis=1)))
