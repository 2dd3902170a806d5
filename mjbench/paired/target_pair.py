"""Two targets that can be launched: what both do is fixed before anything is timed.

Both targets get the same simulations wherever their models have the same size. Each does them once
the plain way; simulations that diverge in either are left out, and the work is compared.
"""

import contextlib
import functools
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjbench import paths
from mjbench.errors import InputError
from mjbench.paired import memory_blocks, operations
from mjbench.paired.call_results import Leaf, compare
from mjbench.paired.metrics import METRICS, Measured
from mjbench.paired.pair_launches import PairTargets, ProcessPair
from mjbench.paired.records import WorkDifference
from mjbench.paired.run_sizes import RUN_S, RunSize, Sizes, run_size
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit, launch_s
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import DrawnWorkload, Observed, ReadyOperation
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.simulation import starts, state_drift
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Product, whole_holds
from mjbench.simulation.workload_sampling import LEAD_IN, SampleRequest
from mjbench.verification import step_costs

# Simulations that start from a file of states, so that they are wherever it was; fewer where a run
# of all would take more seconds than this.
NSTART, DRAWING_S = 64, 0.5
# Steps of a simulation, at least, where a model may sleep: its steps may take a twentieth of those
# that sizes follow from.
LEAST_SLEEPING_NSTEP = 20
# How often a block does an operation, at most.
MAX_REPEATS = 10_000
# What error messages call two targets.
ROLES = "baseline", "candidate"

# Simulations that are drawn for each one of a run. Launches do others of them, so that a verdict
# does not rest on the states of one run.
DRAWN_PER_RUN = 8


class TargetPair(PairTargets):
    """Two targets; files are removed at the end, but the baseline's workload.

    Attributes:
      models: files of both, compiled.
    """

    models: tuple[Path, Path]

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        sizes: Sizes | None = None,
        time_limit: TimeLimit | None = None,
        as_shipped: bool = True,
        roles: tuple[str, str] = ROLES,
    ):
        baseline, candidate = (
            f"{role} (MuJoCo {target.release.version}, {target.model.name})"
            for role, target in zip(roles, targets, strict=True)
        )
        self._targets, self._sizes = targets, sizes or Sizes()
        releases, metric = (targets[0].release, targets[1].release), self._sizes.metric
        limit = time_limit or TimeLimit()
        super().__init__(pool, releases, (baseline, candidate), metric, limit, as_shipped)
        self.nthread = max(target.nthread for target in targets)

    @contextlib.contextmanager
    def loaded(self) -> Iterator[Sequence[WorkerProcess]]:
        """Yield processes that have loaded the models, and start the time limit."""
        pool, processes = self._pool, list[WorkerProcess]()
        try:
            for i, (release, name) in enumerate(zip(self._releases, self._names, strict=True)):
                processes.append(pool.start(release, name, side=i))
            for process, release in zip(processes, self._releases, strict=True):
                pool.wait_for(process, release)
            self.models = pool.new_file(".mjb"), pool.new_file(".mjb")
            self._remove_at_the_end(*self.models)
            for process, target, file in zip(processes, self._targets, self.models, strict=True):
                source, options = target.model, dict(target.model_options)
                process.call(Worker.load_model, source.name, source.path, options)
                process.call(Worker.save_model, file)
            self._time_limit.start()
            yield processes
        finally:
            pool.end(processes)

    def _remove_at_the_end(self, *files: Path) -> None:
        for file in files:
            self._closing.callback(file.unlink, missing_ok=True)


@dataclass(frozen=True)
class _ChosenSizes:
    """What is drawn and timed; `faster_step_s` is None where no run is divided into sections."""

    run: RunSize
    hold: int
    faster_step_s: float | None
    request: SampleRequest
    sleep_alike: bool

    def nsection(self, nbatch: int) -> int:
        return self.run._replace(nbatch=nbatch).nsection(self.faster_step_s, self.hold)


class StepPair(TargetPair):
    """The simulations that two targets step, as often as it takes.

    Attributes:
      workloads: files of the `PortableWorkload`s, final states included.
      nsim: simulations in each workload file.
    """

    work: WorkDifference
    workloads: tuple[Path, Path]
    nsim: int

    def fix_work(self) -> None:
        """Load both models, draw the workload, and see what each target does with it."""
        with self.loaded() as processes:
            chosen = self._choose_sizes(processes)
            self._store(processes, chosen, self._draw(processes, chosen))
        # Simulations may differ in how much slower they are, so they are timed equally often.
        self._times_drawn = [0] * self.nsim
        self._drawn: list[int] = []

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        for process, target, model, workload in zip(
            processes, self._targets, self.models, self.workloads, strict=True
        ):
            process.ask(Worker.equip, model, workload, target.path)

    def lay_out(self, pair: ProcessPair, is_new_run: bool = True) -> tuple[int, int]:
        if is_new_run or self.nsection == 1:
            self._drawn = draw_least(self._times_drawn, self.work.nbatch)
        return super().lay_out(pair)

    def _prepare_blocks(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        target = self._targets[i]
        return process.call(
            target.prepare_run or Worker.prepare_run,
            target.path,
            dict(target.options),
            allowed,
            self._drawn,
            has_timer=target.has_timer,
            returns=self._sizes.returns,
            nsection=self.nsection,
        )

    def _choose_sizes(self, processes: Sequence[WorkerProcess]) -> _ChosenSizes:
        """Return the size of a run, and the request that draws the workload.

        Sizes follow from the costs that tables hold, so they are the same in every run. What is
        measured now decides only whether time will suffice.
        """
        sizes, targets, nthread = self._sizes, self._targets, self.nthread
        step_s, costs_s, settling_nstep = 0.0, list[float](), 0
        sleeps, is_plain_loop = list[bool](), self._is_plain_loop()
        for process in processes:
            nstart = sizes.nbatch or NSTART
            now = process.call(Worker.measure_step_cost, sizes.starts, nstart, sizes.hold)
            settled = functools.partial(process.call, Worker.measure_settled_cost)
            step_s = max(step_s, now.step_s)
            costs_s.append(step_costs.step_cost_s(now.digest, settled))
            cost_s = max(costs_s)
            sleeps.append(now.has_sleep)
            max_nstep = starts.max_settling_nstep(cost_s)
            settling_nstep = min(max(settling_nstep, now.settling_nstep), max_nstep)
            run = run_size(sizes, nthread, cost_s, now.most_nstep)
            if any(sleeps) and is_plain_loop and sizes.nstep is None:
                run = run._replace(
                    nstep=max(run.nstep, whole_holds(LEAST_SLEEPING_NSTEP, sizes.hold))
                )
            drawn = run.nbatch
            if not sizes.nbatch and nthread == 1:
                drawn *= DRAWN_PER_RUN
                if sizes.starts.file is not None or targets[0].model != targets[1].model:
                    affordable = int(DRAWING_S / (run.nstep * cost_s))
                    drawn = max(drawn, min(NSTART, affordable))
            faster_step_s = min(costs_s) if is_plain_loop else None
            nsection = run.nsection(faster_step_s, sizes.hold)
            nrun = 2 if nsection == 1 else 4  # of both targets; where sections warm up, it is twice
            drawing_nstep = _drawing_nstep(drawn, run.nstep, nsection > 1)
            self._time_limit.check_first_launch(
                launch_s(nrun * run.nbatch * run.nstep * step_s / nthread, nsection),
                preparation_s=(settling_nstep + drawing_nstep) * step_s,
            )
        sample = SampleRequest(
            drawn,
            run.nstep,
            sizes.hold,
            sizes.seed,
            sizes.starts,
            max_nstep,
            lead_in=whole_holds(LEAD_IN, sizes.hold) if any(sleeps) and is_plain_loop else 0,
            perturbs=sizes.perturbs,
        )
        return _ChosenSizes(run, sizes.hold, faster_step_s, sample, len(set(sleeps)) == 1)

    def _is_plain_loop(self) -> bool:
        """Return whether all that is timed is to step simulations in the plain loop."""
        is_timed = self._metric.is_of_steps and self._sizes.returns == Product.FINAL
        are_plain = all(each.path == paths.BASE and not each.options for each in self._targets)
        return is_timed and are_plain

    def _draw(
        self, processes: Sequence[WorkerProcess], chosen: _ChosenSizes
    ) -> tuple[DrawnWorkload, DrawnWorkload]:
        """Return the workload of each target: the same one for one model, in whatever releases.

        Two models each settle by themselves: what one comes to is no typical state of the other.
        Where their states have the same fields, the candidate steps from the baseline's probe
        nevertheless, so that results are compared.
        """
        drawn = processes[0].call(Worker.make_workload, chosen.request)
        baseline, candidate = self._targets
        if baseline.model == candidate.model and chosen.sleep_alike:
            return drawn, drawn
        own = processes[1].call(Worker.make_workload, chosen.request)
        probe = drawn.workload.probe
        if _widths(drawn.workload.fields) != _widths(own.workload.fields):
            return drawn, own
        return drawn, replace(own, workload=replace(own.workload, probe=probe))

    def _store(
        self,
        processes: Sequence[WorkerProcess],
        chosen: _ChosenSizes,
        drawn: tuple[DrawnWorkload, DrawnWorkload],
    ) -> None:
        """See what both do with the workload, and store what launches need."""
        shared = drawn[0] is drawn[1]
        workloads = [each.workload for each in drawn]
        nbatch, nsection = chosen.run.nbatch, chosen.nsection(chosen.run.nbatch)
        drawn_nsection = nsection * len(workloads[0].control) // nbatch if nsection > 1 else 1
        observed = []
        for process, workload in zip(processes, workloads, strict=True):
            with self._pool.saved(workload) as file:
                observed.append(process.call(Worker.observe, file, drawn_nsection))
        baseline, candidate = observed
        rows = self._rows_to_time((baseline, candidate), shared)
        self.nsim = len(rows[0])
        is_compared = baseline.healthy & candidate.healthy if shared else baseline.healthy
        self.work = WorkDifference(
            baseline=baseline.work,
            candidate=candidate.work,
            drift=state_drift.drift(baseline.followed, candidate.followed, is_compared, shared),
            diverged=(int((~baseline.healthy).sum()), int((~candidate.healthy).sum())),
            warnings=(baseline.warnings, candidate.warnings),
            nbatch=min(nbatch, self.nsim),
            nstep=chosen.run.nstep,
            starts=drawn[0].starts,
            candidate_starts=None if shared else drawn[1].starts,
            timesteps_s=(baseline.timestep_s, candidate.timestep_s),
        )
        self.workloads = (
            self._pool.save(workloads[0].only(rows[0], baseline.final_state)),
            self._pool.save(workloads[1].only(rows[1], candidate.final_state)),
        )
        self._remove_at_the_end(self.workloads[1])
        self.baseline_workload = self.workloads[0]
        if baseline.can_divide and candidate.can_divide:
            self.nsection = chosen.nsection(self.work.nbatch)

    def _rows_to_time(
        self, observed: tuple[Observed, Observed], shared: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the simulations that each target is timed with; as many, and none diverges."""
        for target, result in zip(self._targets, observed, strict=True):
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


class MemoryPair(StepPair):
    """The simulations of two targets, whose processes are compared by their memory."""

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        """Tell the processes nothing: all that one loads is part of its peak."""

    def _prepare_blocks(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        target, workload = self._targets[i], self.workloads[i]
        options = dict(target.model_options)
        return process.call(memory_blocks.prepare_peak, target.model.path, options, workload)


class OperationPair(TargetPair):
    """An operation around the step, on the models of two targets (see `operations`)."""

    def fix_work(self) -> None:
        """Load the models, and choose how often a block does it."""
        with self.loaded() as processes:
            reads_source = self._metric.reads_source
            self._files = (
                [each.model.path for each in self._targets] if reads_source else self.models
            )
            once = [self._ready(process, i, (), 1) for i, process in enumerate(processes)]
            slower_s = 1e-9 * max(each.ns for each in once)
            self._repeats = min(max(1, round(RUN_S / slower_s)), MAX_REPEATS)
            once_s = 1e-9 * sum(each.ns for each in once)
            self._time_limit.check_first_launch(self.launch_s(once_s))
            timed = [
                self._ready(process, i, (), self._repeats) for i, process in enumerate(processes)
            ]
        old, new = ([[Leaf("", each.result)]] for each in timed)
        self.results = compare(old, new)

    def _prepare_blocks(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return self._ready(process, i, allowed, self._repeats).ns

    def _ready(
        self, process: WorkerProcess, i: int, allowed: Sequence[int], repeats: int
    ) -> ReadyOperation:
        source = ModelSource("", self._files[i])
        prepare = functools.partial(operations.prepare_of(self._sizes.metric), source, repeats)
        return process.call(Worker.prepare_operation, prepare, allowed)


# What two targets do, by how a metric is measured.
_PAIRS: Mapping[Measured, type[TargetPair]] = {
    Measured.STEPS: StepPair,
    Measured.OPERATION: OperationPair,
    Measured.MEMORY: MemoryPair,
}


def pair_of(
    pool: WorkerPool,
    targets: tuple[Target, Target],
    sizes: Sizes | None = None,
    time_limit: TimeLimit | None = None,
    as_shipped: bool = True,
) -> TargetPair:
    """Return two targets to launch, which do what a metric is of."""
    kind = _PAIRS[METRICS[(sizes or Sizes()).metric].measured]
    return kind(pool, targets, sizes, time_limit, as_shipped)


def draw_least(times_drawn: list[int], count: int) -> list[int]:
    """Return indices that were drawn least often, ties at random; count them as drawn."""
    order = sorted(range(len(times_drawn)), key=lambda i: (times_drawn[i], random.random()))
    for i in order[:count]:
        times_drawn[i] += 1
    return order[:count]


def _drawing_nstep(nbatch: int, nstep: int, is_divided: bool) -> int:
    """Return about how many steps it takes to draw a workload, and to see what both do with it."""
    nprobe, npoint = min(nbatch, state_drift.NPROBE), len(state_drift.points(nstep))
    # each simulation: a step to start from, and a run when it is drawn and in each target, where
    # three more show whether sections end in the right states; probed ones: a run and single steps
    # as often
    runs = 9 if is_divided else 3
    return nbatch * (runs * nstep + 1) + nprobe * (3 * nstep + 2 * npoint)


def _widths(fields: Mapping[str, np.ndarray]) -> dict[str, int]:
    return {name: values.shape[1] for name, values in fields.items()}
