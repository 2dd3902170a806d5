"""`mjbench show`: print a run file or a run set again."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import CODE, JSON, RESULTS, with_options

if TYPE_CHECKING:
    from mjbench.store.runs import Run

# Runs of a set that are printed; of more there is a list.
_MOST_RUNS = 20


@cli.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@CODE
@with_options(RESULTS, JSON)
def show(file: Path | None, code: bool, results: Path, json_file: str | None) -> None:
    """Print a run FILE or a run set again; without one, the newest in results/runs.

    Of several machines, it first prints what they show side by side.

    \b
    Examples:
      mjbench show
      mjbench show results/runs/run.jsonl --code
    """
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import run_set, runs

    file = file or runs.latest(results)
    stored = run_set.read(file, RECORD_TYPES)
    with RunContext(json_file, [file]) as run:
        if stored.is_run_file:
            run.write(_shown(run, stored.runs[0], code))
        else:
            _show_set(run, stored.runs, code)


def _show_set(run: RunContext, stored: "Sequence[Run]", code: bool) -> None:
    """Print what machines show side by side, and each run after it; of many runs, a list."""
    from mjbench.report import across_machines, advice_across
    from mjbench.report.documents import RunSetDocument

    results = across_machines.side_by_side(stored)
    if results.has_several:
        for line in advice_across.cautions(results.advice):
            run.out.print(line, soft_wrap=True)
        run.show(filter(None, [across_machines.section(results)]))
    names = [machine.name for machine in results.machines]
    if len(stored) > _MOST_RUNS:
        run.out.print()
        run.table(across_machines.runs_table(stored, names))
        report_line(f"{len(stored)} runs: only listed; `mjbench report` has a section of each")
    else:
        for number, (each, name) in enumerate(zip(stored, names, strict=True), 1):
            run.out.print()
            run.out.rule(f"Run {number} of {len(stored)}: {each.header.command} on {name}")
            _shown(run, each, code)
    run.write(RunSetDocument.of(stored, results))


def _shown(run: RunContext, stored: "Run", code: bool) -> object:
    """Print a run; return its JSON document."""
    from mjbench.report import kinds

    if not stored.records:
        report_line("the run ended before anything was measured")
    kind = kinds.kind_of(stored)
    run.show(kind.sections(stored), code)
    run.hint_at_code()
    return kind.document(stored)
