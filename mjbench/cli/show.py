"""`mjbench show`: run files again, printed, as a page, or beside an earlier run."""

import functools
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import output_file
from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import FILE, takes
from mjbench.commands.show.options import ShowOptions
from mjbench.errors import InputError
from mjbench.status import ExitCode, exit_code

if TYPE_CHECKING:
    from mjbench.commands.show.reports import NamedRun
    from mjbench.results.runs import Run

# Runs that are printed; of more there is a list.
_MOST_RUNS = 20


@cli.command()
@click.argument("files", nargs=-1, metavar="[RUN]…", type=FILE)
@takes(ShowOptions)
def show(files: tuple[Path, ...], options: ShowOptions) -> None:
    """Show run files again; without a RUN, the newest in results/runs.

    They are printed, or written to the files that options name. Runs of several machines start with
    one table, a column a machine.

    --html is one file, which needs no network and nothing beside it. It needs the extra `report`.

    --against compares two runs of `compare`. They were measured at different times, so only what
    certainly differs by more than 5 % is slower or faster. `mjbench versions` and `mjbench ab`
    alternate both, and find smaller changes.

    With --against, --fail-on judges these differences; without, the verdicts that `versions` or
    `ab` stored in RUN.

    \b
    Examples:
      mjbench show
      mjbench show results/runs/run.jsonl --code
      mjbench show --html report.html --csv results.csv
      mjbench show results/runs/*.jsonl --html all.html
      mjbench show --markdown - >> "$GITHUB_STEP_SUMMARY"
      mjbench show --comment comment.md --junit junit.xml
      mjbench show new.jsonl --against old.jsonl --fail-on slower
    """
    from mjbench.commands.show import reports
    from mjbench.results import runs

    against = options.against
    if options.code and (against or output_file.of_options(options)):
        raise InputError("--code prints the code of a RUN: leave it out with a file, or --against")
    if against is not None and len(files) > 1:
        raise InputError("--against compares one RUN with OLD")
    chosen = files or (runs.latest(options.results),)
    if against is not None:
        _show_differences(against, chosen[0], options)
        return
    with RunContext(options, chosen) as run:
        named_runs = reports.read(chosen)
        stored = [named.run for named in named_runs]
        if run.files:
            _write(run, named_runs)
        elif len(stored) == 1:
            _print(run, stored[0], options.code)
        else:
            _print_several(run, stored, options.code)
    if options.findings:
        run.exit_with(_exit_code(stored, options))


def _write(run: RunContext, named_runs: "Sequence[NamedRun]") -> None:
    """Write runs to files; say what to know before their numbers."""
    from mjbench.commands.show import exports, forms

    stored = [named.run for named in named_runs]
    for caution in dict.fromkeys(itertools.chain.from_iterable(map(exports.cautions, stored))):
        report_line(caution)
    run.write_forms(forms.of_runs(named_runs))
    for flag, text_of in exports.BY_FLAG.items():
        if len(stored) > 1 and flag in run.files:
            raise InputError(f"{flag} takes one RUN")
        run.write(flag, functools.partial(text_of, stored[0]))
    _name_files(run)


def _name_files(run: RunContext) -> None:
    for file in run.files.values():
        if not file.is_stdout:
            run.out.print(f"Written: {file.name}", soft_wrap=True)


def _exit_code(stored: "Sequence[Run]", options: ShowOptions) -> int:
    """Return the exit code that the verdicts of runs stand for, the worst one."""
    from mjbench.commands.versions import family
    from mjbench.paired.records import VerdictRecord

    judged = [run for run in stored if run.of_type(VerdictRecord)]
    if not judged:
        raise InputError("--fail-on is about verdicts of `versions` and `ab`, or add --against OLD")

    def code(run: "Run") -> int:
        return options.exit_code_of_run(run, family.confidence_of(run.header))

    worst = max(judged, key=code)
    exit_code = code(worst)
    if len(stored) > 1 and exit_code != ExitCode.OK:
        report_line(f"exit code {exit_code}: mjbench {worst.header.typed_command}")
    return exit_code


def _print_several(run: RunContext, stored: "Sequence[Run]", code: bool) -> None:
    """Print what machines answer side by side, and each run after it; of many runs, a list."""
    from mjbench.commands.show import machines

    compared = machines.of_runs(stored)
    if compared.has_several:
        for line in compared.cautions:
            run.out.print(line, soft_wrap=True)
        run.show(filter(None, [machines.section(compared)]))
    names = [machine.name for machine in compared.identities]
    if len(stored) > _MOST_RUNS:
        run.out.print()
        run.table(machines.runs_table(stored, names))
        report_line(f"{len(stored)} runs: only listed; --html FILE has a section of each")
    else:
        for number, (each, name) in enumerate(zip(stored, names, strict=True), 1):
            run.out.print()
            run.out.rule(f"Run {number} of {len(stored)}: {each.header.command} on {name}")
            _print(run, each, code)


def _print(run: RunContext, stored: "Run", code: bool) -> None:
    from mjbench.commands.show import kinds

    if not stored.records:
        report_line("the run ended before anything was measured")
    kind = kinds.kind_of(stored)
    run.show(kind.sections(stored), code)
    run.hint_at_code()


def _show_differences(old: Path, new: Path, options: ShowOptions) -> None:
    from mjbench.commands.show import forms
    from mjbench.commands.show.kinds import RECORD_TYPES
    from mjbench.commands.show.run_differences import differences, differences_section
    from mjbench.results import runs
    from mjbench.results.json_form import ResultsDocument

    with RunContext(options, [old, new]) as run:
        rows = differences(
            runs.load(old, RECORD_TYPES), runs.load(new, RECORD_TYPES), options.across
        )
        if not rows:
            raise InputError(
                f"{old} and {new} have no timed row of `compare` in common; of verdicts,"
                " `mjbench show RUN --fail-on slower` judges one run"
            )
        sections = [differences_section(rows)]
        run.show(sections)
        run.write_forms(forms.of_sections(sections, ResultsDocument(results=rows), rows))
    code = options.exit_code_of_models([(row.model, row.verdict) for row in rows])
    run.exit_with(exit_code(row.status for row in rows) or code)
