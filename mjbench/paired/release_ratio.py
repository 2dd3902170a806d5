"""Measure a release against the reference, as the history needs it: steps and operations.

Unlike a verdict, which ends when it is certain, a ratio ends when it is known well enough, whatever
it is: so none is biased by when it ended.
"""

import random
import time
from collections.abc import Callable, Sequence

import numpy as np

from mjbench.errors import InputError, MachineError, failure_of
from mjbench.paired import averaging, cores
from mjbench.paired.averaging import Averaging
from mjbench.paired.ending import ENDING_ERRORS, ending_of
from mjbench.paired.process_pairs import ProcessPair, ProcessPairs
from mjbench.paired.protocol import Launch, time_quads
from mjbench.paired.release_tasks import ReleaseTask
from mjbench.paired.time_limit import MIN_QUADS, quad_count
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_ratios
from mjbench.releases.release_ratios import LaunchRatio, RatioRecord

# How often a launch lays out the memory of a task anew, and by what the quads of a verdict's layout
# are divided. Many short launches are better than a few long ones: the time of some models differs
# more between launches than within one, and the processes of the next start meanwhile.
_LAYOUTS, _QUADS_DIVISOR = 2, 3
# A task that is alone is timed in more layouts until these are ready, up to this number.
_MAX_LAYOUTS = 6


def measure(
    pool: WorkerPool,
    tasks: Sequence[ReleaseTask],
    on_launch: Callable[[int], None] = lambda count: None,
    clock: Callable[[], float] = time.monotonic,
) -> list[RatioRecord]:
    """Compare a release with the reference in each of the tasks, which are of the same two.

    Where a release crashes, hangs or fails in a task, or Ctrl-C is pressed, the records say so, and
    hold what was measured until then.

    Args:
      pool: starts the processes.
      tasks: what to time; one or more.
      on_launch: called after each launch, with the number of launches so far.
      clock: returns seconds.

    Returns:
      A record for each task, in their order.
    """
    begin_s, averaged = clock(), Averaging(False)
    reference, release = tasks[0].releases
    try:
        averaged = averaging.averaging(pool, reference, release)
        _launch_all(pool, tasks, averaged, on_launch, clock)
    except ENDING_ERRORS as error:
        for task in tasks:
            if not task.is_complete:
                task.failure = task.failure or ending_of(error)
    finally:
        for task in tasks:
            task.close()
    seconds = (clock() - begin_s) / len(tasks)
    return [task.record(averaged.problem, seconds) for task in tasks]


def _launch_all(
    pool: WorkerPool,
    tasks: Sequence[ReleaseTask],
    averaged: Averaging,
    on_launch: Callable[[int], None],
    clock: Callable[[], float],
) -> None:
    """Launch until all tasks are known well enough."""
    reference, release = tasks[0].releases
    names = f"reference (MuJoCo {reference.version})", f"release (MuJoCo {release.version})"
    pairs = ProcessPairs(pool, (reference, release), names, averaged.placements())
    try:
        for task in tasks:
            try:
                task.prepare(pool)
            except (InputError, MachineError) as error:
                task.failure = failure_of(error)
        begin_s, count = clock(), 0
        remaining = [task for task in tasks if task.failure is None]
        while remaining:
            pairs.wait()
            chosen = cores.freest_cores()
            core = chosen[0] if chosen else None
            with pairs.batch(chosen) as (pair,), cores.pinned(core):
                tasks_in_turn = random.sample(remaining, len(remaining))
                _time_all(tasks_in_turn, pair, core, pairs.are_next_ready)
            count += 1
            on_launch(count)
            seconds = clock() - begin_s
            for task in remaining:
                task.is_complete = release_ratios.are_enough(task.launches, seconds)
            remaining = [t for t in remaining if not t.is_complete and t.failure is None]
    finally:
        pairs.close()


def _time_all(
    tasks: Sequence[ReleaseTask],
    pair: ProcessPair,
    core: int | None,
    are_next_ready: Callable[[], bool],
) -> None:
    """Time each task once; one that fails says how, and ends the launch if its process may have."""
    is_enough = are_next_ready if len(tasks) == 1 else lambda: True
    for task in tasks:
        try:
            launch = _time(task, pair, core, is_enough)
        except (InputError, MachineError) as error:
            task.failure = failure_of(error)
            if isinstance(error, MachineError):
                return
        else:
            task.add(LaunchRatio(launch.log_ratio, pair.placements.new), launch.baseline_ns)


def _time(
    task: ReleaseTask, pair: ProcessPair, core: int | None, is_enough: Callable[[], bool]
) -> Launch:
    """Time a task in a few layouts of memory, each with fewer quads than a verdict's."""
    orders: list[str] = []
    ns: list[np.ndarray] = []
    processes = pair.processes
    task.equip(processes)
    while len(ns) < _LAYOUTS or (len(ns) < _MAX_LAYOUTS and not is_enough()):
        task.pair_s = min(task.pair_s, 1e-9 * sum(task.ready(processes, core)))
        count = max(MIN_QUADS, quad_count(task.pair_s) // _QUADS_DIVISOR)
        # the first quad warms up both: what was prepared last would have the advantage in it
        layout_orders, layout_ns = time_quads(*processes, count + 1)
        orders += layout_orders[1:]
        ns.append(layout_ns[1:])
    return Launch(core, None, orders, np.concatenate(ns), pair.placements)
