"""What both targets do, fixed before anything is timed: models, workload, check of the work.

Both targets get the same simulations wherever their models have the same size. Each does them once
the plain way; simulations that diverge in either are left out, and the work is compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mjbench.errors import InputError
from mjbench.paired import requests
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit, launch_s
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.simulation import agreement
from mjbench.simulation.work import Work
from mjbench.simulation.workload import PortableWorkload, whole_holds

# Seconds of a block. The shorter it is, the closer in time the two blocks of a pair, and the fewer
# blocks are hit by what else the machine does. The longer it is, the less its cold start counts,
# which both targets share and which makes any change look smaller.
BLOCK_S = 0.001
# Steps of each simulation of a block, at most.
MAX_NSTEP = 100
# Seconds of a block for each thread of a path with threads: long enough that starting the threads
# is not what is measured.
THREADED_BLOCK_S = 0.01
# Simulations that are drawn for each one of a block. Every layout does others of them, so that a
# verdict does not rest on the states of one block.
DRAWN_PER_BLOCK = 8


@dataclass(frozen=True)
class Sizes:
    """The work of a block, as the user asked for it.

    Attributes:
      nbatch: simulations; None chooses them from what a step costs.
      nstep: steps of each simulation; None chooses them from what a step costs.
      hold: steps for which each control is held.
      seed: of start states and controls.
    """

    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0


class BlockSize(NamedTuple):
    """Simulations of a block, and steps of each."""

    nbatch: int
    nstep: int


@dataclass(frozen=True)
class WorkCheck:
    """Whether both targets do the same work.

    Attributes:
      baseline: work per step of the baseline.
      candidate: work per step of the candidate.
      drift: largest difference of qpos, qvel and act one step after the same states, in SI units;
        None where the models differ in size.
      diverged: simulations that diverged in the baseline, and in the candidate; none of those is
        timed.
      warnings: how many other simulations raised each warning, in the baseline, and in the
        candidate.
      nbatch: simulations of a block.
      nstep: steps of each.
    """

    baseline: Work
    candidate: Work
    drift: float | None
    diverged: tuple[int, int]
    warnings: tuple[Mapping[str, int], Mapping[str, int]]
    nbatch: int
    nstep: int

    @property
    def changes(self) -> list[str]:
        """How the work changed, in a few words each; empty where it is the same."""
        return agreement.work_changes(self.baseline, self.candidate, self.drift, self.diverged)

    @property
    def changed(self) -> bool:
        """Whether counters, or the result of one step beyond rounding, differ."""
        return bool(self.changes)


@dataclass(frozen=True)
class Preparation:
    """What every launch of two targets starts from. Pairs are of the baseline and the candidate.

    Attributes:
      models: files of the compiled models, options set.
      workloads: files of the `PortableWorkload`s, final states included.
      nsim: simulations in each workload file.
      work_check: whether the two do the same work.
    """

    models: tuple[Path, Path]
    workloads: tuple[Path, Path]
    nsim: int
    work_check: WorkCheck


def describe(targets: Sequence[Target]) -> tuple[str, str]:
    """Return the names of a baseline and a candidate, for error messages."""
    baseline, candidate = (
        f"{role} (MuJoCo {target.release.version}, {target.model.name})"
        for role, target in zip(("baseline", "candidate"), targets, strict=True)
    )
    return baseline, candidate


def prepare(
    pool: WorkerPool, targets: tuple[Target, Target], sizes: Sizes, time_limit: TimeLimit
) -> Preparation:
    """Load both models, draw the workload, and see what each target does with it.

    The files of the result last as long as the pool.

    Args:
      pool: starts the processes.
      targets: baseline and candidate.
      sizes: of a block.
      time_limit: starts when the models are loaded.

    Raises:
      InputError: a target cannot do this work.
      TargetError: a target crashed, hung or failed.
      OutOfTimeError: the limit does not allow a launch.
    """
    processes: list[WorkerProcess] = []
    try:
        for target, name in zip(targets, describe(targets), strict=True):
            processes.append(pool.start(target.release, name))
        for process, target in zip(processes, targets, strict=True):
            pool.wait_for(process, target.release)
        models = _load(pool, targets, processes)
        time_limit.start()
        block, request = _choose_sizes(targets, sizes, processes, time_limit)
        workloads = _draw(pool, targets, processes, request)
        return _prepared(pool, targets, processes, models, workloads, block)
    finally:
        pool.end(processes)


def _load(
    pool: WorkerPool, targets: Sequence[Target], processes: Sequence[WorkerProcess]
) -> tuple[Path, Path]:
    """Load both models, set their options, and save them; return the files."""
    models = (pool.new_file(".mjb"), pool.new_file(".mjb"))
    for process, target, file in zip(processes, targets, models, strict=True):
        source, options = target.model, dict(target.model_options)
        process.call(requests.LoadModel(source.name, source.path, options))
        process.call(requests.SaveModel(file))
    return models


def _choose_sizes(
    targets: Sequence[Target],
    sizes: Sizes,
    processes: Sequence[WorkerProcess],
    time_limit: TimeLimit,
) -> tuple[BlockSize, requests.MakeWorkload]:
    """Return the size of a block, and the request that draws the workload.

    Raises:
      OutOfTimeError: the limit does not allow to draw it, and to launch once.
    """
    nthread, step_s = max(target.nthread for target in targets), 0.0
    for process in processes:
        step_s = max(step_s, process.call(requests.MeasureStepCost()))
        block = _block_size(sizes, nthread, step_s)
        drawn = block.nbatch
        if not sizes.nbatch and nthread == 1:
            drawn *= DRAWN_PER_BLOCK
        time_limit.check_first_launch(
            launch_s(2 * block.nbatch * block.nstep * step_s / nthread),
            # a step to start from and one run to draw them; a run and a step for each target
            preparation_s=drawn * (3 * block.nstep + 3) * step_s,
        )
    return block, requests.MakeWorkload(drawn, block.nstep, sizes.hold, sizes.seed)


def _prepared(
    pool: WorkerPool,
    targets: tuple[Target, Target],
    processes: Sequence[WorkerProcess],
    models: tuple[Path, Path],
    workloads: tuple[PortableWorkload, PortableWorkload],
    block: BlockSize,
) -> Preparation:
    """See what each target does with its workload; save what is to be timed.

    Args:
      pool: holds the files.
      targets: baseline and candidate.
      processes: of the targets.
      models: files of the models.
      workloads: of the targets.
      block: what is timed at a time.
    """
    shared = workloads[0] is workloads[1]
    observed = []
    for process, workload in zip(processes, workloads, strict=True):
        with pool.saved(workload) as file:
            observed.append(process.call(requests.Observe(file)))
    baseline, candidate = observed
    rows = _rows_to_time(targets, (baseline, candidate), shared)
    nsim = len(rows[0])
    work_check = WorkCheck(
        baseline=baseline.work,
        candidate=candidate.work,
        drift=_drift(baseline, candidate, rows[0]) if shared else None,
        diverged=(int((~baseline.healthy).sum()), int((~candidate.healthy).sum())),
        warnings=(baseline.warnings, candidate.warnings),
        nbatch=min(block.nbatch, nsim),
        nstep=block.nstep,
    )
    files = (
        pool.save(workloads[0].only(rows[0], baseline.final_state)),
        pool.save(workloads[1].only(rows[1], candidate.final_state)),
    )
    return Preparation(models, files, nsim, work_check)


def _block_size(sizes: Sizes, nthread: int, step_s: float) -> BlockSize:
    """Return a size such that a block takes about BLOCK_S where the user leaves it open.

    Args:
      sizes: as the user asked.
      nthread: threads of the target that has more.
      step_s: seconds of a step of the target that is slower.
    """
    block_s = BLOCK_S if nthread == 1 else nthread * THREADED_BLOCK_S
    steps, hold = max(1, int(block_s / step_s)), sizes.hold
    if sizes.nbatch:
        nstep = sizes.nstep or whole_holds(steps // sizes.nbatch, hold)
        return BlockSize(sizes.nbatch, nstep)
    nstep = sizes.nstep or whole_holds(min(steps, MAX_NSTEP), hold)
    return BlockSize(max(1 if nthread == 1 else 4 * nthread, steps // nstep), nstep)


def _draw(
    pool: WorkerPool,
    targets: Sequence[Target],
    processes: Sequence[WorkerProcess],
    request: requests.MakeWorkload,
) -> tuple[PortableWorkload, PortableWorkload]:
    """Return the workload of each target: the same one, unless their models differ in size."""
    workload = processes[0].call(request)
    try:
        with pool.saved(workload) as file:
            processes[1].call(requests.TakeWorkload(file))
    except InputError:
        if targets[0].model == targets[1].model:
            raise
        return workload, processes[1].call(request)
    return workload, workload


def _rows_to_time(
    targets: Sequence[Target], observed: tuple[requests.Observed, requests.Observed], shared: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the simulations that each target is timed with: as many, and none that diverges.

    Where the workload is shared they are the same ones.

    Raises:
      InputError: there are none.
    """
    for target, result in zip(targets, observed, strict=True):
        if not result.healthy.any():
            raise InputError(
                f"{target.model.name} with MuJoCo {target.release.version}: every simulation"
                f" diverges ({result.diagnosis}); there is nothing to compare"
            )
    if shared:
        rows = np.flatnonzero(observed[0].healthy & observed[1].healthy)
        if len(rows) == 0:
            raise InputError(
                "every simulation diverges in the baseline or in the candidate;"
                " there is nothing to compare"
            )
        return rows, rows
    baseline, candidate = (np.flatnonzero(result.healthy) for result in observed)
    count = min(len(baseline), len(candidate))
    return baseline[:count], candidate[:count]


def _drift(
    baseline: requests.Observed, candidate: requests.Observed, rows: np.ndarray
) -> float | None:
    """Return how far one step from the same states differs; None where the sizes differ."""
    before, after = (
        {field: values[rows] for field, values in observed.after_one_step.items()}
        for observed in (baseline, candidate)
    )
    if any(after[field].shape != values.shape for field, values in before.items()):
        return None
    return agreement.drift(after, before)
