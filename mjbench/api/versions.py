"""`mjbench.versions`: is a model slower with a new release of MuJoCo than with an old one?"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.api import checks, model_sources, revisions, start_states
from mjbench.api.measured import Measured
from mjbench.api.session import Item, Measurement, Observer, input_files, pinning_notes
from mjbench.counts import explain
from mjbench.counts.explain import InstructionComparison
from mjbench.counts.instructions import InstructionCounter
from mjbench.errors import InputError
from mjbench.limits import SECONDS, SEED, SHARE
from mjbench.measuring.progress import Progress
from mjbench.paired import environment_sides, family, outcomes, targets, verdict
from mjbench.paired.compiled_sides import CompiledComparison
from mjbench.paired.environment_sides import EnvironmentComparison
from mjbench.paired.family import Family
from mjbench.paired.metrics import COMPILING_METRICS, Metric
from mjbench.paired.records import VerdictRecord, VerdictRow, finished
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths import BASE, find
from mjbench.releases import installs, packages
from mjbench.releases.installs import ReleaseSpec
from mjbench.simulation import models as shipped_models
from mjbench.simulation.models import ModelSource
from mjbench.store.runs import Record
from mjbench.units import listed

if TYPE_CHECKING:
    import os

    from mjbench.api.start_states import Actions, States


@dataclass(frozen=True, repr=False, eq=False)
class ReleaseComparison(Measured):
    """Verdicts on models in an old and in new releases of MuJoCo."""

    @property
    def verdicts(self) -> tuple[VerdictRow, ...]:
        return tuple(record.row() for record in self.run.of_type(VerdictRecord))

    @property
    def confidence(self) -> float:
        return family.confidence_of(self.run.header)

    @property
    def family(self) -> Family:
        """Which are slower, faster or undecided when one allows for their number."""
        return family.decide(self.verdicts, self.confidence)


def versions(
    old: str,
    *news: str,
    models: "str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None" = None,
    paths: str | Iterable[str] | None = None,
    metric: str = Metric.TIME.value,
    min_effect: float = outcomes.MIN_EFFECT,
    confidence: float = outcomes.CONFIDENCE,
    precision: float = outcomes.PRECISION,
    time_limit_s: float = outcomes.TIME_LIMIT_S,
    as_shipped: bool = False,
    nbatch: int | None = None,
    nstep: int | None = None,
    hold: int = 1,
    seed: int = 0,
    settle_s: float | None = None,
    states: "States | None" = None,
    actions: "Actions | None" = None,
    wait: bool = False,
    on_progress: Progress | None = None,
) -> ReleaseComparison:
    """Compare models in an old release of MuJoCo and in new ones: are they slower?

    The same as `mjbench versions`. Each release is installed in a folder of its own in the cache.
    Ratios are new over old: above 1 is slower. A model that fails loses only its own verdict,
    unless all fail.

    Args:
      old: a version (`3.5.0`), a wheel, a folder of wheels, `installed`, `newest` or `previous`; or
        packages, with commas, such as `jax==0.7.0,jaxlib==0.7.0`.
      *news: the same, one or several.
      models: names as on the command line, or paths; None for all shipped models. A compiled
        model cannot be compared: other releases cannot load it.
      paths: names of C paths, or of paths that compile, such as `mjx`, each compared between the
        releases; None for `python_loop`.
      metric: what to compare: `time`, `p99` (the time that 99 of 100 steps do not exceed),
        `instructions`, which needs valgrind, the time of `load`, `reset`, `rays`, or of a short
        call of `rollout` or `batch`, the peak of `memory`, its `growth` with steps, the size of the
        `arena`, or the time that paths take to `compile`.
      min_effect: smallest change that matters, as a share; a change that is certainly smaller is
        `same`.
      confidence: of the interval, as a share.
      precision: stop when half the interval's width is below this share.
      time_limit_s: for each verdict, once the models are loaded; after it, an uncertain one is
        `inconclusive`.
      as_shipped: whether to compare builds with their machine code where it lies in memory.
      nbatch: simulations of a run.
      nstep: steps of each simulation.
      hold: steps for which each control is held: an environment's frame_skip.
      seed: of start states and controls.
      settle_s: simulated seconds for which the model moves before the first start state; 0 starts
        at keyframe 0, None stands for 0.1 with a keyframe, and for 5 without.
      states: a file of start states, or arrays by MjData field, as `mjbench.record` returns and
        `mjbench.capture` stores them.
      actions: a file of controls, or an array (ncontrol, nu) or (nsequence, ncontrol, nu), in place
        of random ones.
      wait: whether to wait until no other mjbench measures on this machine.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such release, model or path, an argument is out of its range, or no
        model can be compared.
      MachineError: a package or a release is missing, or processes failed for every model.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    path_names = None if paths is None else checks.names("paths", paths)
    chosen = checks.choice("metric", metric, Metric)
    if not news:
        raise InputError('name an old and a new release, such as versions("3.3.0", "4.0.0")')
    specs = [installs.parse_release(str(name)) for name in (old, *news)]
    sources = model_sources.each_once(map(model_sources.named, _several(models)))
    with start_states.plan(settle_s, states, actions) as starts:
        sizes = Sizes(
            checks.optional(checks.whole, "nbatch", nbatch),
            checks.optional(checks.whole, "nstep", nstep),
            checks.whole("hold", hold),
            checks.whole("seed", seed, SEED),
            starts,
            metric=chosen,
        )
        checks.holds(sizes.nstep, sizes.hold)
        plan = VerdictPlan(
            checks.number("min_effect", min_effect, SHARE),
            checks.number("confidence", confidence, SHARE),
            checks.number("precision", precision, SHARE),
            checks.number("time_limit_s", time_limit_s, SECONDS),
            sizes,
            as_shipped,
        )
        measurement = measurement_of(specs, sources, path_names, plan)
        return ReleaseComparison.of(measurement, wait, on_progress)


def measurement_of(
    specs: Sequence[ReleaseSpec],
    sources: Sequence[ModelSource],
    path_names: Sequence[str] | None,
    plan: VerdictPlan,
    functions: Sequence[str] = (),
) -> Measurement:
    """Return the measurement of models, or of functions, in environments, the baseline first.

    Args:
      path_names: None where the user names none.
      functions: as the user names them, such as `bench.py::step`.

    Raises:
      InputError: there is no such path or function, or these cannot be compared like that.
    """
    (baseline, *candidates), metric = specs, plan.sizes.metric
    if functions:
        if path_names:
            raise InputError("--paths are of models, not of functions")
        revisions.check_function_plan(plan)
        cwd = Path.cwd().resolve()
        parsed = environment_sides.parse_functions(functions, cwd)
        return revisions.environment_verdicts(
            EnvironmentComparison(baseline, candidates, parsed, cwd), plan
        )
    if not path_names:
        _check_packages(specs)
        path_names = [BASE]
    if compiling := [name for name in path_names if find(name).compiles]:
        others = [name for name in path_names if name not in compiling]
        if others or metric not in COMPILING_METRICS:
            named, known = listed(compiling), " or ".join(COMPILING_METRICS)
            unfit = listed(others) if others else f"--metric {metric}"
            raise InputError(f"{named} can be compared alone, by {known}: leave out {unfit}")
        return revisions.compiled_verdicts(
            CompiledComparison(baseline, candidates, sources, path_names, plan.sizes), plan
        )
    targets.check_metric(metric, path_names)
    if metric == Metric.INSTRUCTIONS:
        comparison = InstructionComparison(baseline, candidates, sources, plan.min_effect)
        return instructions(comparison, plan)
    pairs = targets.of_releases(baseline, candidates, sources, path_names)
    return verdicts("versions", pairs, replace(plan, family=max(len(pairs), plan.family)))


def _check_packages(specs: Sequence[ReleaseSpec]) -> None:
    """Refuse packages that the default path does not use: it would be the same on both sides.

    Raises:
      InputError: there is one.
    """
    named = packages.names_of([part for spec in specs for part in spec.beside])
    if unused := sorted(named - {"numpy"}):
        raise InputError(
            f"{BASE} does not use {listed(unused)}: name a path that does, such as --paths mjx, or"
            " a function, --function"
        )


def verdicts(
    command: str, pairs: Sequence[tuple[Target, Target]], plan: VerdictPlan
) -> Measurement:
    """Return the measurement of verdicts on pairs of baseline and candidate."""
    sides = [target for pair in pairs for target in pair]

    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        with WorkerPool() as pool:
            for result in verdict.decide_each(pool, pairs, plan, finished(earlier), observer):
                yield Item([result.record()])

    return Measurement(
        command,
        {**asdict(plan), "targets": [target.row() for target in sides]},
        [*(file for target in sides for file in target.files), *plan.sizes.starts.files],
        measure,
        finished,
        pinning_notes(),
    )


def instructions(comparison: InstructionComparison, plan: VerdictPlan) -> Measurement:
    builds, sources = [comparison.baseline, *comparison.candidates], comparison.sources

    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        def on_candidate(number: int) -> None:
            version = comparison.candidates[number].version
            observer(f"MuJoCo {version}", number / len(comparison.candidates))

        with InstructionCounter(plan.sizes) as counter:
            for record in explain.verdicts(comparison, counter, finished(earlier), on_candidate):
                yield Item([record])

    return Measurement(
        "versions",
        {
            **asdict(plan),
            "metric": Metric.INSTRUCTIONS,
            "releases": [release.key for release in builds],
            "models": [source.name for source in sources],
        },
        input_files(sources, builds, plan.sizes.starts),
        measure,
        finished,
    )


def _several(
    models: "str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None",
) -> "Sequence[str | os.PathLike[str]]":
    if models is None:
        return shipped_models.shipped()
    if isinstance(models, str) or not isinstance(models, Iterable):
        return [models]
    return list(models)
