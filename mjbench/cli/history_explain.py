"""`mjbench history explain`: instructions by function, from each release to the next."""

from collections.abc import Sequence
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
    from mjbench.counts.explain import Explainer
    from mjbench.counts.instructions import InstructionCounter, ModelCount
    from mjbench.counts.records import ExplainRecord
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.simulation.models import ModelSource

# Of each model and pair of releases, as many functions are stored.
TOP = 12


@history.command("explain")
@click.argument("names", nargs=-1, metavar="[RELEASE]…")
@with_options(*history_options.SELECTING, HISTORY, RESUME)
def explain(
    names: tuple[str, ...],
    since: str | None,
    models: tuple[str, ...],
    results: Path,
    history: Path | None,
    resume: Path | None,
) -> None:
    """Count the instructions of a step by function, from each RELEASE to the next.

    Needs valgrind, but no quiet machine. A release takes about 30 seconds. The workload is that of
    one fixed release.

    \b
    Example:
      mjbench history explain --since 3.17.0
    """
    from mjbench.counts import records
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.releases import installs, step_ratios
    from mjbench.report.counts import print_changes
    from mjbench.simulation import models as model_sources

    releases = history_options.releases(names, since, history)
    if len(releases) < 2:
        raise InputError("give two releases or more")
    sources = [model_sources.resolve(name) for name in models or model_sources.shipped()]
    reference = installs.parse_release(step_ratios.REFERENCE)
    arguments = {
        "reference": reference.key,
        "releases": [release.key for release in releases],
        "models": [source.name for source in sources],
    }
    storage = Storage(results, arguments, resume, records.finished)
    files = [source.path for source in sources]
    with (
        RunContext("history-explain", None, files, storage) as run,
        InstructionCounter() as counter,
    ):
        counter.count(reference, sources)  # draws the workloads
        stored = _count_all(run, counter, releases, sources)
        print_changes(run.out, stored)
    run.exit(record.status for record in stored)


def _count_all(
    run: RunContext,
    counter: "InstructionCounter",
    releases: Sequence["ReleaseSpec"],
    sources: Sequence["ModelSource"],
) -> list["ExplainRecord"]:
    """Count each release, and store what changed since the one before; return all records."""
    from mjbench.counts import records
    from mjbench.counts.explain import Explainer

    stored = list(records.finished(run.resumed_records))
    done = {(record.old, record.new, record.model) for record in stored}
    explainer = Explainer()
    before: Sequence[ModelCount] = ()
    with run.progress(len(releases)) as advance:
        for number, release in enumerate(releases):
            advance(number, f"MuJoCo {release.version}", 0.0)
            counts = counter.count(release, sources)
            for old, new in zip(before, counts, strict=bool(before)):
                if (old.release, new.release, new.model) not in done:
                    record = _record(explainer, old, new)
                    run.record(record)
                    stored.append(record)
            before = counts
    return stored


def _record(explainer: "Explainer", old: "ModelCount", new: "ModelCount") -> "ExplainRecord":
    """Return what changed in a model, with the functions that changed most."""
    from mjbench.counts.records import ExplainRecord

    row = explainer.row(old, new, time=None)
    return ExplainRecord(**{**vars(row), "functions": row.functions[:TOP]})
