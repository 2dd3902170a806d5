"""Measurements that come to verdicts: of `versions` and `ab`, and of the functions of `api`.

They differ in what is compared: models in releases or with other settings, functions of the user's
code in revisions or environments, or models that a path steps which compiles (to the engine that
times, these are functions, too).
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

from mjbench import formats
from mjbench.commands.versions import accelerated_environments, function_sides, function_verdict
from mjbench.commands.versions.accelerated_environments import AcceleratedComparison
from mjbench.commands.versions.function_sides import (
    EnvironmentComparison,
    FunctionTarget,
    FunctionTargets,
    RevisionComparison,
)
from mjbench.commands.versions.target_verdict import decide_targets
from mjbench.errors import InputError
from mjbench.formats import listed
from mjbench.host import platforms
from mjbench.limits import TIME_LIMIT_S
from mjbench.measuring.timing import Progress
from mjbench.paired import targets
from mjbench.paired.metrics import METRICS
from mjbench.paired.records import Judgement, TargetRow, VerdictRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths import BASE, find
from mjbench.releases import named_packages
from mjbench.releases.release_names import ReleaseSpec
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, finished, input_files
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

# Seconds without an answer after which a process that compiles is killed.
_COMPILER_PATIENCE_S = 600.0
# After as many launches, a comparison shows half of its work as done.
_HALFWAY_LAUNCHES = 15

_Side = TypeVar("_Side", bound=Target | FunctionTarget)
# Makes both sides of all comparisons ready, and is called with a function for a line of progress.
_Prepare = Callable[[WorkerPool, Callable[[str], None]], Sequence[tuple[_Side, _Side]]]


def between_releases(
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
    metric = plan.sizes.metric
    if functions:
        if path_names:
            raise InputError("--paths are of models, not of functions")
        check_function_plan(plan)
        cwd = Path.cwd().resolve()
        parsed = function_sides.parse_functions(functions, cwd, Path(cwd.anchor))
        comparison = EnvironmentComparison(specs, parsed, cwd)
        if missing := next((file for file in comparison.files if not file.is_file()), None):
            raise InputError(f"there is no file {missing}")
        return _of_functions(comparison, plan)
    if not path_names:
        _check_packages(specs)
        path_names = [BASE]
    if compiling := [name for name in path_names if find(name).compiles]:
        others = [name for name in path_names if name not in compiling]
        if others or not METRICS[metric].of_compiling_paths:
            named = listed(compiling)
            known = " or ".join(m for m, spec in METRICS.items() if spec.of_compiling_paths)
            unfit = listed(others) if others else f"--metric {metric}"
            raise InputError(f"{named} can be compared alone, by {known}: leave out {unfit}")
        compiled = AcceleratedComparison(specs, sources, path_names, plan.sizes)
        return _of_compiled(compiled, plan)
    targets.check_metric(metric, path_names)
    pairs = targets.of_releases(specs, sources, path_names)
    return between_targets("versions", pairs, replace(plan, family=max(len(pairs), plan.family)))


def _check_packages(specs: Sequence[ReleaseSpec]) -> None:
    """Refuse packages that the default path does not use: it would be the same on both sides.

    Raises:
      InputError: there is one.
    """
    named = named_packages.names_of([part for spec in specs for part in spec.beside])
    if unused := sorted(named - {"numpy"}):
        raise InputError(
            f"{BASE} does not use {listed(unused)}: name a path that does, such as --paths mjx, or"
            f" in place of a model a function, {function_sides.FORM}"
        )


def between_targets(
    command: str, pairs: Sequence[tuple[Target, Target]], plan: VerdictPlan
) -> Measurement:
    """Return the measurement of pairs of baseline and candidate."""
    sides = [target for pair in pairs for target in pair]
    return _measurement(
        command,
        plan,
        {"targets": [target.row() for target in sides]},
        [*(file for target in sides for file in target.files), *plan.sizes.starts.files],
        lambda pool, on_phase: pairs,
        _decide_targets,
    )


def _decide_targets(
    pool: WorkerPool, pair: tuple[Target, Target], plan: VerdictPlan, on_progress: Progress
) -> VerdictRecord:
    name = f"{pair[1].model.name}, MuJoCo {pair[1].release.version}"
    on_progress(name, 0.0)
    return decide_targets(pool, *pair, plan, _shown_launch(name, on_progress))


def between_revisions(comparison: RevisionComparison, plan: VerdictPlan) -> Measurement:
    """Return the measurement of functions in two revisions, `mjbench ab main HEAD …`."""
    revisions = comparison.baseline, comparison.candidate
    measurement = _function_measurement(
        "ab",
        plan,
        {
            "revisions": [asdict(revision) for revision in revisions],
            "functions": [function.text for function in comparison.functions],
            "own_files": comparison.own_files,
        },
        comparison.files,
        len(comparison.functions),
        lambda pool, on_phase: function_sides.check_out(pool, comparison, on_phase),
    )
    return replace(measurement, notes=[*comparison.notes, *measurement.notes])


def _of_functions(comparison: EnvironmentComparison, plan: VerdictPlan) -> Measurement:
    specs = comparison.specs
    return _function_measurement(
        "versions",
        plan,
        {
            "releases": [spec.key for spec in specs],
            "functions": [function.text for function in comparison.functions],
        },
        comparison.files,
        len(comparison.functions) * (len(specs) - 1),
        lambda pool, on_phase: function_sides.install_all(comparison),
    )


def _of_compiled(comparison: AcceleratedComparison, plan: VerdictPlan) -> Measurement:
    comparison = accelerated_environments.with_engines(comparison)
    names, sources = comparison.path_names, comparison.sources
    return _function_measurement(
        "versions",
        plan,
        {
            "releases": [spec.key for spec in comparison.specs],
            "models": [source.name for source in sources],
            "paths": list(names),
        },
        input_files(sources, comparison.specs, plan.sizes.starts),
        len(sources) * len(names) * (len(comparison.specs) - 1),
        lambda pool, on_phase: accelerated_environments.prepare_targets(pool, comparison),
        _COMPILER_PATIENCE_S,
    )


def check_function_plan(plan: VerdictPlan) -> None:
    """Refuse a plan that says what is of models alone, where functions are compared.

    Raises:
      InputError: it does.
    """
    metric = plan.sizes.metric
    if plan.sizes != Sizes(metric=metric):
        raise InputError("sizes, start states and controls are of models, not of functions")
    if not METRICS[metric].of_functions:
        raise InputError(f"--metric {metric} is of models, not of functions")


def _function_measurement(
    command: str,
    plan: VerdictPlan,
    arguments: Mapping[str, Any],
    files: Sequence[Path],
    count: int,
    prepare: _Prepare[FunctionTarget],
    patience_s: float = TIME_LIMIT_S,
) -> Measurement:
    """Return the measurement of a number of verdicts; both sides run where code lies as it does."""
    plan = replace(plan, family=max(plan.family, count), as_shipped=True)
    return _measurement(command, plan, arguments, files, prepare, _decide_functions, patience_s)


def _decide_functions(
    pool: WorkerPool, pair: FunctionTargets, plan: VerdictPlan, on_progress: Progress
) -> VerdictRecord:
    name = " ".join(filter(None, (pair[1].function, pair[1].path)))
    on_progress(name, 0.0)
    return function_verdict.decide_function(pool, pair, plan, _shown_launch(name, on_progress))


def _measurement(
    command: str,
    plan: VerdictPlan,
    arguments: Mapping[str, Any],
    files: Sequence[Path],
    prepare: _Prepare[_Side],
    decide: Callable[[WorkerPool, tuple[_Side, _Side], VerdictPlan, Progress], VerdictRecord],
    patience_s: float = TIME_LIMIT_S,
) -> Measurement:
    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        done = {_sides_key(each.sides) for each in earlier if isinstance(each, VerdictRecord)}
        begin_s = time.monotonic()
        with WorkerPool(patience_s) as pool:
            pairs = prepare(pool, observer.begin)
            undecided = [_sides_key([side.row() for side in pair]) not in done for pair in pairs]
            shares = plan.budget.divided(sum(undecided), observer.begin, begin_s=begin_s)
            for number, pair in enumerate(pairs):
                if not undecided[number]:
                    continue

                def on_progress(name: str, share: float, number: int = number) -> None:
                    observer(name, (number + share) / len(pairs))

                timed = replace(plan, time_limit_s=shares.next_s())
                record = decide(pool, pair, timed, on_progress)
                yield Item([record])
                if record.status == Status.INTERRUPTED:
                    return

    return Measurement(
        command, {**asdict(plan), **arguments}, files, measure, finished, platforms.pinning_notes()
    )


def _sides_key(sides: Sequence[TargetRow]) -> str:
    return repr([asdict(side) for side in sides])


def _shown_launch(name: str, on_progress: Progress) -> Callable[[Judgement], None]:
    """Return what shows, after each launch, what launches come to so far."""

    def on_launch(judgement: Judgement) -> None:
        text = f"{name} {formats.change(judgement.ratio.estimate)}"
        on_progress(text, completed_share(judgement.launches))

    return on_launch


def completed_share(launches: int) -> float:
    """Return the share of a comparison that some launches are shown as; it never reaches 1."""
    return 1 - 1 / (1 + launches / _HALFWAY_LAUNCHES)
