"""C of the release that the builds are of: the workload, what C does with it, and its speed.

C runs in processes of its own, in which that release is installed alone (see `paired.worker`).
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjbench import paths
from mjbench.comparison import step_costs
from mjbench.comparison.plan import Variant
from mjbench.errors import InputError
from mjbench.paired import cores
from mjbench.paired.run_sizes import RunSize, Sizes
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation import starts
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Work
from mjbench.simulation.rounding_reference import ReferenceRun, RoundingReference
from mjbench.simulation.starts import Starts
from mjbench.simulation.workload import PortableWorkload, whole_holds
from mjbench.simulation.workload_sampling import SampleRequest
from mjbench.web.records import C_PATH

# Simulations that are compared, and steps of each, unless the user says otherwise.
NBATCH, NSTEP = 16, 100
# Fewer simulations where one pass over all would take C more seconds than this, but so many.
_PASS_S, _MIN_NBATCH = 1.0, 2
# Seconds of a timed block of C: the first steps of the first simulations, as many as fit, but at
# least so many steps of one.
_BLOCK_S, _MIN_BLOCK_NSTEP = 0.01, 10


@dataclass(frozen=True, eq=False)
class CReference:
    """A model, its workload, and what C does with that.

    Attributes:
      files: that the model is compiled from, its own first.
      block_file: holds the workload of a timed block, final states included.
      compile_ms: to compile the model, with loading its files.
    """

    files: tuple[str, ...]
    model_file: Path
    block_file: Path
    digest: str
    traced: RoundingReference
    work: Work
    starts: Starts
    block: RunSize
    compile_ms: float


def prepare(
    pool: WorkerPool,
    release: ReleaseSpec,
    source: ModelSource,
    sizes: Sizes,
    clock: Callable[[], float] = time.perf_counter,
) -> CReference:
    """Load a model, draw its workload, and see what C does with it.

    The files of the result last as long as the pool.
    """
    process = pool.start(release, f"C of MuJoCo {release.version} ({source.name})")
    try:
        pool.wait_for(process, release)
        begin = clock()
        process.call(Worker.load_model, source.name, source.path, {})
        compile_ms = 1e3 * (clock() - begin)
        files = process.call(Worker.list_files, source.path)
        model_file = pool.new_file(".mjb")
        process.call(Worker.save_model, model_file)
        sample, step_s = _sample(process, sizes)
        drawn = process.call(Worker.make_workload, sample)
        with pool.saved(drawn.workload) as file:
            observed = process.call(Worker.observe, file)
        healthy = np.flatnonzero(observed.healthy)
        if not len(healthy):
            raise InputError(f"every simulation diverges ({observed.diagnosis})")
        workload = drawn.workload.only(healthy, observed.final_state)
        with pool.saved(workload) as file:
            traced = process.call(Worker.trace, file, sizes.seed)
        block = block_size(traced.run, step_s)
        return CReference(
            files,
            model_file,
            pool.save(_first(workload, traced.run, block)),
            workload.digest(),
            traced,
            observed.work,
            drawn.starts,
            block,
            compile_ms,
        )
    finally:
        pool.end([process])


def block_size(run: ReferenceRun, step_s: float) -> RunSize:
    nbatch, nstep = run.states.shape[1], len(run.states) - 1
    fitting = max(_MIN_BLOCK_NSTEP, int(_BLOCK_S / step_s))
    block_nstep = min(nstep, whole_holds(fitting, run.hold))
    return RunSize(max(1, min(nbatch, fitting // block_nstep)), block_nstep)


def _first(workload: PortableWorkload, run: ReferenceRun, block: RunSize) -> PortableWorkload:
    first = workload.only(np.arange(block.nbatch), run.states[block.nstep])
    return replace(first, control=first.control[:, : block.nstep // run.hold])


def _sample(process: WorkerProcess, sizes: Sizes) -> tuple[SampleRequest, float]:
    nstart = sizes.nbatch or NBATCH
    now = process.call(Worker.measure_step_cost, sizes.starts, nstart, sizes.hold)
    step_s = step_costs.step_cost_s(now.digest, lambda: process.call(Worker.measure_settled_cost))
    nstep = sizes.nstep or whole_holds(NSTEP, sizes.hold)
    affordable = max(_MIN_NBATCH, int(_PASS_S / (nstep * step_s)))
    sample = SampleRequest(
        sizes.nbatch or min(NBATCH, affordable),
        nstep,
        sizes.hold,
        sizes.seed,
        sizes.starts,
        starts.max_settling_nstep(step_s),
        may_shorten=sizes.nstep is None,
    )
    return sample, step_s


@contextlib.contextmanager
def timed_paths(
    pool: WorkerPool,
    release: ReleaseSpec,
    reference: CReference,
    variants: Sequence[Variant],
    core: int | None,
) -> Iterator[list[WorkerProcess]]:
    """Yield a process for each path of C, which `time_block` steps the first simulations of.

    They step without the timer of MuJoCo's Python package, which the builds do not have either.
    """
    processes: list[WorkerProcess] = []
    try:
        for i, variant in enumerate(variants):
            process = pool.start(release, f"{variant} of MuJoCo {release.version}", side=i)
            processes.append(process)
            process.ask(Worker.equip, reference.model_file, reference.block_file, variant.path)
        for process, variant in zip(processes, variants, strict=True):
            pool.wait_for(process, release)
            process.call(
                Worker.prepare,
                variant.path,
                dict(variant.options),
                cores.usable(core),
                range(reference.block.nbatch),
                has_timer=False,
            )
        for process in processes:
            process.ask(Worker.time_blocks)
        yield processes
        for process in processes:
            process.end_blocks()
    finally:
        pool.end(processes)


def variants() -> list[Variant]:
    """Return the paths of C that builds are timed beside: the plain loop, and one thread of C."""
    choices: dict[str, dict[str, int]] = {paths.BASE: {}, C_PATH: {"threads": 1}}
    return [Variant(name, paths.find(name).complete(options)) for name, options in choices.items()]
