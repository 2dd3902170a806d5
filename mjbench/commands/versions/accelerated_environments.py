"""Models that a path steps which compiles, such as MJX, in two environments.

To the engine that times, they are functions (see `accelerated_function`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.commands.versions import function_sides
from mjbench.commands.versions.function_sides import FunctionTarget, FunctionTargets, SteppedRun
from mjbench.errors import InputError
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.timed_function import FunctionSource
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import DrawnWorkload
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths.accelerated import accelerated_path
from mjbench.releases import named_packages
from mjbench.releases.release_names import INSTALLED, ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import whole_holds
from mjbench.simulation.workload_sampling import SampleRequest

# Simulations and steps of a run, unless the user says.
NBATCH, NSTEP = 32, 10


@dataclass(frozen=True)
class AcceleratedComparison:
    """Models to compare in environments, the baseline first, by paths that compile."""

    specs: Sequence[ReleaseSpec]
    sources: Sequence[ModelSource]
    path_names: Sequence[str]
    sizes: Sizes


def with_engines(comparison: AcceleratedComparison) -> AcceleratedComparison:
    """Return a comparison whose environments have what the paths need, where it is not named."""
    names = [accelerated_path(name).distributions for name in comparison.path_names]
    needed = sorted({name for each in names for name in each} - {"mujoco"})
    return replace(comparison, specs=[_with(spec, needed) for spec in comparison.specs])


def _with(spec: ReleaseSpec, needed: Sequence[str]) -> ReleaseSpec:
    """Return a release with packages beside it: this environment's versions with its MuJoCo."""
    if spec.name == INSTALLED:
        raise InputError(
            f"name the packages in place of {INSTALLED}, such as jax==0.7.0: both sides"
            " get an environment of their own"
        )
    named = named_packages.names_of(spec.beside)
    here = named_packages.versions(None)
    is_here = here.get("mujoco") == spec.version
    added = [
        f"{name}=={here[name]}" if is_here and name in here and name.startswith("mujoco") else name
        for name in needed
        if name not in named
    ]
    name = spec.name if spec.has_packages else f"mujoco=={spec.version}"
    return replace(spec, name=name, requirements=(*spec.requirements, *added), has_packages=True)


def prepare_targets(pool: WorkerPool, comparison: AcceleratedComparison) -> list[FunctionTargets]:
    origins = [function_sides.install(spec) for spec in comparison.specs]
    caches = {spec.key: pool.new_folder() for spec in comparison.specs}
    pairs = []
    for source in comparison.sources:
        drawn = _draw(pool, comparison, source)
        file, (nbatch, ncontrol, _) = pool.save(drawn.workload), drawn.workload.control.shape
        nstep = ncontrol * drawn.workload.hold
        for name in comparison.path_names:
            baseline, *candidates = (
                FunctionTarget(
                    source.name,
                    None,
                    "",
                    _source(source, name, file, caches[spec.key], comparison.sizes.metric),
                    origin,
                    spec,
                    SteppedRun(name, nbatch, nstep, drawn.starts),
                )
                for spec, origin in zip(comparison.specs, origins, strict=True)
            )
            pairs += [(baseline, candidate) for candidate in candidates]
    return pairs


def _draw(
    pool: WorkerPool, comparison: AcceleratedComparison, source: ModelSource
) -> DrawnWorkload:
    sizes, baseline = comparison.sizes, comparison.specs[0]
    nstep = sizes.nstep or whole_holds(NSTEP, sizes.hold)
    request = SampleRequest(sizes.nbatch or NBATCH, nstep, sizes.hold, sizes.seed, sizes.starts)
    with pool.ready(baseline, f"baseline ({baseline.label})") as process:
        process.call(Worker.load_model, source.name, source.path, {})
        return process.call(Worker.make_workload, request)


def _source(
    source: ModelSource, path_name: str, workload: Path, cache: Path, metric: Metric
) -> FunctionSource:
    """Return a module with the function of a model, for a process to import.

    No package that the path imports may have the module's name.
    """
    arguments = (
        f"ModelSource({source.name!r}, Path({str(source.path)!r})), {path_name!r},"
        f" Path({str(workload)!r})"
    )
    call = f"compiled_step({arguments}, Path({str(cache)!r}))"
    if METRICS[metric].compiles:
        call = f"compilation({arguments})"
    text = (
        "from pathlib import Path\n"
        "from mjbench.paired.accelerated_function import compilation, compiled_step\n"
        "from mjbench.simulation.models import ModelSource\n"
        f"step = {call}\n"
    )
    module = f"mjbench_{path_name}"
    return FunctionSource("step", module, f"{module}.py", text.encode())
