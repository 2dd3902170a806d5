"""Measure the time of a step of a release over that of the reference, as the history needs it.

Unlike a verdict, which ends when it is certain, a ratio ends when it is known well enough, whatever
it is: so none is biased by when it ended.
"""

import pickle
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from mjbench.paired import averaging
from mjbench.paired.averaging import Averaging
from mjbench.paired.ending import ENDING_ERRORS, ending_of
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.protocol import TargetPair
from mjbench.paired.targets import Target
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import step_ratios
from mjbench.releases.step_ratios import LaunchRatio, StepRatioRecord
from mjbench.simulation.workload import PortableWorkload
from mjbench.status import Status


def measure(
    pool: WorkerPool,
    reference: Target,
    target: Target,
    on_launch: Callable[[int], None] = lambda count: None,
    clock: Callable[[], float] = time.monotonic,
) -> StepRatioRecord:
    """Compare a release with the reference on the reference's workload.

    Where a target crashes, hangs or fails, or Ctrl-C is pressed, the record says so, and holds what
    was measured until then.

    Args:
      pool: starts the processes.
      reference: the release that all are compared with, and the model.
      target: the other release, and the same model.
      on_launch: called after each launch, with the number of launches so far.
      clock: returns seconds.
    """
    begin_s = clock()
    launches: list[LaunchRatio] = []
    reference_ns: list[float] = []
    pair: TargetPair | None = None
    averaged = Averaging(False)
    workload, status, detail = "", Status.OK, ""
    try:
        averaged = averaging.averaging(pool, reference, target)
        pair = TargetPair(pool, reference, target, placements=averaged.placements())
        workload = _digest(pair)
        first_s = clock()
        while not step_ratios.are_enough(launches, clock() - first_s):
            launch = pair.launch()
            launches.append(LaunchRatio(launch.log_ratio, launch.placements.new))
            reference_ns.append(launch.baseline_ns)
            on_launch(len(launches))
    except ENDING_ERRORS as error:
        ending = ending_of(error)
        status, detail = ending.status, ending.detail
    finally:
        if pair is not None:
            pair.close()
    record = StepRatioRecord(
        model=target.model.name,
        release=target.release.version,
        build=target.release.key,
        reference=reference.release.version,
        status=status,
        detail=detail,
        launches=launches,
        problem=averaged.problem,
        workload=workload,
        seconds=clock() - begin_s,
    )
    return record if pair is None else _with_work(record, pair.work_check, reference_ns)


def _with_work(
    record: StepRatioRecord, check: WorkCheck, reference_ns: Sequence[float]
) -> StepRatioRecord:
    """Return a record with the work of both releases, and the time of a step of the reference.

    Args:
      record: without them.
      check: of the work.
      reference_ns: median nanoseconds of the reference's blocks, launch by launch.
    """
    return replace(
        record,
        work=check.candidate,
        reference_work=check.baseline,
        diverged=check.diverged[1],
        reference_diverged=check.diverged[0],
        drift=check.drift.one_step if check.drift else None,
        run_drift=check.drift.runs if check.drift else (),
        nbatch=check.nbatch,
        nstep=check.nstep,
        starts=check.starts,
        reference_step_s=_step_s(reference_ns, check.nbatch * check.nstep),
    )


def _step_s(block_ns: Sequence[float], steps: int) -> float | None:
    """Return the seconds of a step, from nanoseconds of blocks; None without any."""
    return 1e-9 * statistics.median(block_ns) / steps if block_ns else None


def _digest(pair: TargetPair) -> str:
    """Return the digest of the reference's workload."""
    workload: PortableWorkload = pickle.loads(pair.baseline_workload.read_bytes())
    return workload.digest()
