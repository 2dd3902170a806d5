"""Instructions by function, from each release of the history to the next."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from benchmarks.history.tasks import Selection
from mjbench.counts.counted_program import OperationRequest
from mjbench.counts.explain import explain_change
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.counts.records import ExplainRecord
from mjbench.measuring.timing import Progress

# Functions that are stored of each model and pair of releases, beside those that exchanged cost
# with them.
_TOP = 12


def count_rest(
    selection: Selection, earlier: Sequence[object], on_progress: Progress
) -> Iterator[list[ExplainRecord]]:
    """Count each release, and yield what changed since the one before and is not known yet."""
    done = {(r.old, r.new, r.series) for r in earlier if isinstance(r, ExplainRecord)}
    missing = _releases_to_count(selection, done)
    operations = [
        OperationRequest(each.name, each.source, each.prepare, each.repeats)
        for each in selection.operations
    ]
    before: Sequence[ModelCount] = ()
    with InstructionCounter() as counter:
        if missing and selection.sources:
            list(counter.count(selection.reference, selection.sources))  # draws the workloads
        for number, release in enumerate(selection.releases):
            on_progress(f"MuJoCo {release.version}", number / len(selection.releases))
            if release.version not in missing:
                before = ()
                continue
            counts = [
                *counter.count(release, selection.sources),
                *counter.count(release, operations),
            ]
            yield [
                _record(old, new)
                for old, new in zip(before, counts, strict=bool(before))
                if (old.release, new.release, new.operation or new.model) not in done
            ]
            before = counts


def _releases_to_count(selection: Selection, done: set[tuple[str, str, str]]) -> set[str]:
    versions = [release.version for release in selection.releases]
    return {
        version
        for old, new in itertools.pairwise(versions)
        for version in (old, new)
        if any((old, new, name) not in done for name in selection.names)
    }


def _record(old: ModelCount, new: ModelCount) -> ExplainRecord:
    """Return what changed in a model: functions that changed most, and whose cost moved there."""
    row = explain_change(old, new, time=None)
    names = {name for f in row.functions[:_TOP] for name in (f.name, *f.moved_with)}
    functions = [function for function in row.functions if function.name in names]
    return replace(row, functions=functions)
