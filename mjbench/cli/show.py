"""`mjbench show`: run files again, printed, as a page, or beside an earlier run."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import show_pages
from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import FILE, takes
from mjbench.commands.show.options import ShowOptions
from mjbench.errors import InputError
from mjbench.status import ExitCode, exit_code

if TYPE_CHECKING:
    from mjbench.results.runs import Run

# Runs that are printed; of more there is a list.
_MOST_RUNS = 20


@cli.command()
@click.argument("files", nargs=-1, metavar="[RUN]…", type=FILE)
@click.option("--html", "form", flag_value="html", help="Write a page to look at, mail or attach.")
@click.option(
    "--markdown", "form", flag_value="markdown", help="For a job's summary or a pull request."
)
@click.option(
    "--format",
    "form",
    type=click.Choice(show_pages.FORMATS),
    help="html, markdown, comment (verdicts, for a pull request), or a format of other tools.",
)
@takes(ShowOptions)
def show(files: tuple[Path, ...], form: str | None, options: ShowOptions) -> None:
    """Show run files again; without a RUN, the newest in results/runs.

    Runs of several machines start with one table, a column a machine.

    --html is one file, which needs no network and nothing beside it. Its charts need
    vl-convert-python and Jinja2: the extra `report`.

    --against compares two runs of `compare`. They were measured at different times, so only what
    certainly differs by more than 5 % is slower or faster. `mjbench versions` and `mjbench ab`
    alternate both, and find smaller changes.

    With --against, --fail-on judges these differences; without, the verdicts that `versions` or
    `ab` stored in RUN.

    \b
    Examples:
      mjbench show
      mjbench show results/runs/run.jsonl --code
      mjbench show --html report.html
      mjbench show results/runs/*.jsonl --html -o all.html
      mjbench show --markdown >> "$GITHUB_STEP_SUMMARY"
      mjbench show --format comment -o comment.md
      mjbench show --format junit -o junit.xml
      mjbench show new.jsonl --against old.jsonl --fail-on slower
    """
    from mjbench.results import runs

    against, output = options.against, options.output
    if against is not None and (form or options.code):
        raise InputError("--against prints a table: leave out --code and formats")
    if form and (options.code or options.json_file or options.findings):
        raise InputError(
            "--code, --json and --fail-on belong to what is printed: leave out the format"
        )
    if output and not form:
        raise InputError("-o is for a page or a format: add --html, --markdown or --format")
    if form == "html" and not output and files and files[-1].suffix == ".html":
        files, output = files[:-1], str(files[-1])
    if against is None:
        chosen = files or (runs.latest(options.results),)
        if form:
            show_pages.write(chosen, form, output)
        else:
            _print(chosen, options)
        return
    if len(files) > 1:
        raise InputError("--against compares one RUN with OLD")
    _show_differences(against, files[0] if files else runs.latest(options.results), options)


def _print(files: Sequence[Path], options: ShowOptions) -> None:
    """Print runs, and write their JSON document; end with the exit code of their verdicts."""
    from mjbench.commands.show.kinds import RECORD_TYPES
    from mjbench.results import runs

    with RunContext(options.json_file, files) as run:
        stored = [runs.load(file, RECORD_TYPES) for file in dict.fromkeys(files)]
        if len(stored) == 1:
            run.write(_shown(run, stored[0], options.code))
        else:
            _print_several(run, stored, options.code)
    if options.findings:
        run.exit_with(_exit_code(stored, options))


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
    from mjbench.commands.show.documents import MachinesDocument

    compared = machines.of_runs(stored)
    if compared.has_several:
        for line in compared.cautions:
            run.out.print(line, soft_wrap=True)
        run.show(filter(None, [machines.section(compared)]))
    names = [machine.name for machine in compared.identities]
    if len(stored) > _MOST_RUNS:
        run.out.print()
        run.table(machines.runs_table(stored, names))
        report_line(f"{len(stored)} runs: only listed; `mjbench show --html` has a section of each")
    else:
        for number, (each, name) in enumerate(zip(stored, names, strict=True), 1):
            run.out.print()
            run.out.rule(f"Run {number} of {len(stored)}: {each.header.command} on {name}")
            _shown(run, each, code)
    run.write(MachinesDocument.of(stored, compared))


def _shown(run: RunContext, stored: "Run", code: bool) -> object:
    from mjbench.commands.show import kinds

    if not stored.records:
        report_line("the run ended before anything was measured")
    kind = kinds.kind_of(stored)
    run.show(kind.sections(stored), code)
    run.hint_at_code()
    return kind.document(stored)


def _show_differences(old: Path, new: Path, options: ShowOptions) -> None:
    from mjbench.commands.show.kinds import RECORD_TYPES
    from mjbench.commands.show.run_differences import differences, differences_section
    from mjbench.results import runs
    from mjbench.results.json_form import ResultsDocument

    with RunContext(options.json_file, [old, new]) as run:
        rows = differences(
            runs.load(old, RECORD_TYPES), runs.load(new, RECORD_TYPES), options.across
        )
        if not rows:
            raise InputError(
                f"{old} and {new} have no timed row of `compare` in common; of verdicts,"
                " `mjbench show RUN --fail-on slower` judges one run"
            )
        run.show([differences_section(rows)])
        run.write(ResultsDocument(results=rows))
    code = options.exit_code_of_models([(row.model, row.verdict) for row in rows])
    run.exit_with(exit_code(row.status for row in rows) or code)
