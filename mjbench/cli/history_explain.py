"""`mjbench history explain`: instructions by function, from each release to the next."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import history_options
from mjbench.cli.context import RunContext, Storage
from mjbench.cli.history import history
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import RESUME, with_options
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.counts.counted_program import OperationRequest
    from mjbench.counts.explain import Explainer
    from mjbench.counts.instructions import InstructionCounter, ModelCount
    from mjbench.counts.records import ExplainRecord

# Of each model and pair of releases, as many functions are stored, and those that exchanged cost
# with them.
TOP = 12


@history.command("explain")
@click.argument("names", nargs=-1, metavar="[RELEASE]…")
@with_options(
    history_options.STEPS,
    history_options.OPERATIONS,
    *history_options.SELECTING,
    HISTORY,
    RESUME,
)
def explain(
    names: tuple[str, ...],
    steps: bool,
    operations: bool | None,
    since: str | None,
    models: tuple[str, ...],
    results: Path,
    history: Path | None,
    resume: Path | None,
) -> None:
    """Count instructions of steps and operations by function, from each RELEASE to the next.

    Needs valgrind, but no quiet machine. A release takes several minutes for the ten shipped
    models, and less than one for the operations. The workload of steps is that of one fixed
    release.

    \b
    Example:
      mjbench history explain --since 3.17.0
    """
    from mjbench.counts import records
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.report.counts import change_sections

    selection = history_options.select(names, since, models, history, steps, operations)
    if len(selection.releases) < 2:
        raise InputError("give two releases or more")
    storage = Storage(results, selection.arguments(), resume, records.finished)
    files = [source.path for source in selection.sources]
    with (
        RunContext("history-explain", None, files, storage) as run,
        InstructionCounter() as counter,
    ):
        stored = _count_all(run, counter, selection)
        run.show(change_sections(stored))
    run.exit(record.status for record in stored)


def _count_all(
    run: RunContext,
    counter: "InstructionCounter",
    selection: history_options.Selection,
) -> list["ExplainRecord"]:
    """Count each release, and store what changed since the one before; return all records."""
    from mjbench.counts import records
    from mjbench.counts.explain import Explainer

    stored = list(records.finished(run.resumed_records))
    done = {(record.old, record.new, record.series) for record in stored}
    selected = [source.name for source in selection.sources]
    selected += [operation.name for operation in selection.operations]
    missing = {
        version
        for old, new in itertools.pairwise(release.version for release in selection.releases)
        for version in (old, new)
        if any((old, new, name) not in done for name in selected)
    }
    if missing and selection.sources:
        counter.count(selection.reference, selection.sources)  # draws the workloads
    explainer = Explainer()
    before: Sequence[ModelCount] = ()
    with run.progress(len(selection.releases)) as advance:
        for number, release in enumerate(selection.releases):
            advance(number, f"MuJoCo {release.version}", 0.0)
            if release.version not in missing:
                before = ()
                continue
            counts = counter.count(release, selection.sources)
            counts += counter.count(release, _requests(selection))
            for old, new in zip(before, counts, strict=bool(before)):
                if (old.release, new.release, new.operation or new.model) not in done:
                    record = _record(explainer, old, new)
                    run.record(record)
                    stored.append(record)
            before = counts
    return stored


def _requests(selection: history_options.Selection) -> list["OperationRequest"]:
    """Return what is asked of each release beside the steps of models."""
    from mjbench.counts.counted_program import OperationRequest
    from mjbench.simulation import models

    return [
        OperationRequest(
            operation.name, models.resolve(operation.model) if operation.model else None
        )
        for operation in selection.operations
    ]


def _record(explainer: "Explainer", old: "ModelCount", new: "ModelCount") -> "ExplainRecord":
    """Return what changed in a model: functions that changed most, and whose cost moved there."""
    row = explainer.row(old, new, time=None)
    names = {name for f in row.functions[:TOP] for name in (f.name, *f.moved_with)}
    functions = [function for function in row.functions if function.name in names]
    return replace(row, functions=functions)
