"""What is measured of functions: of the user's code in two revisions or in two environments.

Models that a path steps which compiles are functions, too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from mjbench.api.session import Item, Measurement, Observer, input_files, pinning_notes
from mjbench.errors import InputError
from mjbench.measuring.progress import Progress
from mjbench.paired import (
    compiled_sides,
    environment_sides,
    function_verdict,
    revision_sides,
)
from mjbench.paired.compiled_sides import CompiledComparison
from mjbench.paired.environment_sides import EnvironmentComparison
from mjbench.paired.function_pair import FunctionTargets
from mjbench.paired.judgement import Judgement
from mjbench.paired.metrics import FUNCTION_METRICS
from mjbench.paired.records import VerdictRecord, finished
from mjbench.paired.revision_sides import RevisionComparison
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.verdict import VerdictPlan, completed_share, sides_key
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status
from mjbench.store.runs import Record
from mjbench.units import percent_change

# Seconds without an answer after which a process is killed: a function's, and a compiler's.
_PATIENCE_S, _COMPILER_PATIENCE_S = 60.0, 600.0
# Makes both sides of all comparisons ready, and is called with a function for a line of progress.
_Prepare = Callable[[WorkerPool, Callable[[str], None]], Sequence[FunctionTargets]]


def revision_verdicts(comparison: RevisionComparison, plan: VerdictPlan) -> Measurement:
    revisions = comparison.baseline, comparison.candidate
    measurement = _measurement(
        "ab",
        plan,
        {
            "revisions": [asdict(revision) for revision in revisions],
            "functions": [function.text for function in comparison.functions],
        },
        comparison.files,
        len(comparison.functions),
        lambda pool, on_phase: revision_sides.check_out(pool, comparison, on_phase),
    )
    return replace(measurement, notes=[*comparison.notes, *measurement.notes])


def environment_verdicts(comparison: EnvironmentComparison, plan: VerdictPlan) -> Measurement:
    specs = comparison.baseline, *comparison.candidates
    return _measurement(
        "versions",
        plan,
        {
            "releases": [spec.key for spec in specs],
            "functions": [function.text for function in comparison.functions],
        },
        comparison.files,
        len(comparison.functions) * len(comparison.candidates),
        lambda pool, on_phase: environment_sides.install_all(comparison),
    )


def compiled_verdicts(comparison: CompiledComparison, plan: VerdictPlan) -> Measurement:
    comparison = compiled_sides.with_engines(comparison)
    names, sources = comparison.path_names, comparison.sources
    return _measurement(
        "versions",
        plan,
        {
            "releases": [spec.key for spec in comparison.specs],
            "models": [source.name for source in sources],
            "paths": list(names),
        },
        input_files(sources, comparison.specs, plan.sizes.starts),
        len(sources) * len(names) * len(comparison.candidates),
        lambda pool, on_phase: compiled_sides.prepare(pool, comparison),
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
    if metric not in FUNCTION_METRICS:
        raise InputError(f"--metric {metric} is of models, not of functions")


def _measurement(
    command: str,
    plan: VerdictPlan,
    arguments: Mapping[str, Any],
    files: Sequence[Path],
    count: int,
    prepare: _Prepare,
    patience_s: float = _PATIENCE_S,
) -> Measurement:
    """Return the measurement of a number of verdicts; both sides run where code lies as it does."""
    plan = replace(plan, family=max(plan.family, count), as_shipped=True)

    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        done = {sides_key(record.sides) for record in finished(earlier)}
        with WorkerPool(patience_s) as pool:
            all_targets = prepare(pool, observer.begin)
            for number, targets in enumerate(all_targets):
                if sides_key([target.row() for target in targets]) in done:
                    continue

                def on_progress(name: str, share: float, number: int = number) -> None:
                    observer(name, (number + share) / len(all_targets))

                record = _decide(pool, targets, plan, on_progress)
                yield Item([record])
                if record.status == Status.INTERRUPTED:
                    return

    return Measurement(
        command, {**asdict(plan), **arguments}, files, measure, finished, pinning_notes()
    )


def _decide(
    pool: WorkerPool, targets: FunctionTargets, plan: VerdictPlan, on_progress: Progress
) -> VerdictRecord:
    name = " ".join(filter(None, (targets[1].function, targets[1].path)))
    on_progress(name, 0.0)

    def on_launch(judgement: Judgement) -> None:
        text = f"{name} {percent_change(judgement.ratio.estimate)} %"
        on_progress(text, completed_share(judgement.launches))

    return function_verdict.decide(pool, targets, plan, on_launch)
