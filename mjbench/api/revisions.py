"""What is measured of functions: of the user's code in two revisions or in two environments.

Models that a path steps which compiles are functions, too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from mjbench.api.session import Item, Measurement, Observer, input_files, pinning_notes
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
from mjbench.paired.records import VerdictRecord, finished
from mjbench.paired.revision_sides import RevisionComparison
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
    plan = replace(plan, family=len(comparison.functions), as_shipped=True)
    revisions = comparison.baseline, comparison.candidate
    measurement = _measurement(
        "ab",
        plan,
        {
            "revisions": [asdict(revision) for revision in revisions],
            "functions": [function.text for function in comparison.functions],
        },
        comparison.files,
        lambda pool, on_phase: revision_sides.check_out(pool, comparison, on_phase),
    )
    return replace(measurement, notes=[*comparison.notes, *measurement.notes])


def environment_verdicts(comparison: EnvironmentComparison, plan: VerdictPlan) -> Measurement:
    """Return the measurement of verdicts on functions in environments."""
    count = len(comparison.functions) * len(comparison.candidates)
    specs = comparison.baseline, *comparison.candidates
    return _measurement(
        "versions",
        replace(plan, family=max(plan.family, count), as_shipped=True),
        {
            "releases": [spec.key for spec in specs],
            "functions": [function.text for function in comparison.functions],
        },
        comparison.files,
        lambda pool, on_phase: environment_sides.install_both(comparison),
    )


def compiled_verdicts(comparison: CompiledComparison, plan: VerdictPlan) -> Measurement:
    """Return the measurement of verdicts on models that paths step which compile."""
    comparison = compiled_sides.with_engines(comparison)
    names, sources = comparison.path_names, comparison.sources
    count = len(sources) * len(names) * len(comparison.candidates)
    return _measurement(
        "versions",
        replace(plan, family=max(plan.family, count), as_shipped=True),
        {
            "releases": [spec.key for spec in comparison.specs],
            "models": [source.name for source in sources],
            "paths": list(names),
        },
        input_files(sources, comparison.specs, plan.sizes.starts),
        lambda pool, on_phase: compiled_sides.prepare(pool, comparison),
        _COMPILER_PATIENCE_S,
    )


def _measurement(
    command: str,
    plan: VerdictPlan,
    arguments: Mapping[str, Any],
    files: Sequence[Path],
    prepare: _Prepare,
    patience_s: float = _PATIENCE_S,
) -> Measurement:
    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        done = {sides_key(record.sides) for record in finished(earlier)}
        with WorkerPool(patience_s) as pool:
            all_targets = prepare(pool, observer.begin)
            for number, targets in enumerate(all_targets):
                if sides_key([target.row() for target in targets]) in done:
                    continue
                record = _decide(pool, targets, plan, observer, number / len(all_targets))
                yield Item([record])
                if record.status == Status.INTERRUPTED:
                    return

    return Measurement(
        command, {**asdict(plan), **arguments}, files, measure, finished, pinning_notes()
    )


def _decide(
    pool: WorkerPool, targets: FunctionTargets, plan: VerdictPlan, observer: Observer, share: float
) -> VerdictRecord:
    """Return the verdict on one function; `share` of all work is done before it."""
    name = " ".join(filter(None, (targets[1].function, targets[1].path)))
    observer(name, share)

    def on_launch(judgement: Judgement) -> None:
        text = f"{name} {percent_change(judgement.ratio.estimate)} %"
        observer(text, share + completed_share(judgement.launches) / plan.family)

    return function_verdict.decide(pool, targets, plan, on_launch)
