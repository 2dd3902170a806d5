"""`mjbench show`: run files again, printed, written to files, or two of them side by side."""

import functools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import output_file
from mjbench.cli.command_help import Command
from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, command_line, report_line
from mjbench.cli.shared import FILE, takes
from mjbench.commands.show.options import ShowOptions
from mjbench.errors import InputError
from mjbench.status import ExitCode, exit_code

if TYPE_CHECKING:
    from mjbench.commands.show.reports import NamedRun
    from mjbench.results.runs import Run

# Files that `FormOptions` names.
_FORMS = {"--html", "--markdown", "--csv", "--json"}


class _ShowCommand(Command):
    """A command whose arguments may be numbers of stored runs, such as -2."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        return super().parse_args(
            ctx, [f"./{word}" if re.fullmatch(r"-\d+", word) else word for word in args]
        )


@cli.command(cls=_ShowCommand)
@click.argument("files", nargs=-1, metavar="[RUN]…", type=FILE)
@takes(ShowOptions)
def show(files: tuple[Path, ...], options: ShowOptions) -> None:
    """Show run files again: the newest, or each RUN, printed or written to files.

    RUN is a file, or -1 for the newest in --results, -2 for the one before it, and so on.

    Two RUNs of one kind, model and machine are put side by side, the older as the baseline. They
    were measured at different times: of `compare`, only what certainly differs by more than 5 % is
    slower or faster. `mjbench versions` and `mjbench ab` alternate both, and find smaller changes.

    Other RUNs are shown one after the other. Those of several machines start with one table, a
    column a machine.

    --fail-on judges the verdicts that `versions` or `ab` stored, or two runs of `compare`.

    \b
    Examples:
      mjbench show --list
      mjbench show -2 --code
      mjbench show --html report.html --csv results.csv
      mjbench show results/runs/*.jsonl --html all.html
      mjbench show --markdown - >> "$GITHUB_STEP_SUMMARY"
      mjbench show --comment comment.md --junit junit.xml
      mjbench show old.jsonl new.jsonl --fail-on slower
    """
    from mjbench.commands.show import reports, side_by_side
    from mjbench.results import runs

    if options.lists_runs:
        if files:
            raise InputError("--list takes no RUN: it lists those in --results")
        _list(runs.newest_first(options.results), options)
        return
    if options.code and output_file.of_options(options):
        raise InputError("--code is for what is printed: leave it out with a file")
    chosen = [runs.of_name(name, options.results) for name in files or [Path("-1")]]
    with RunContext(options, chosen) as run:
        named_runs = reports.read(chosen)
        stored = [named.run for named in named_runs]
        if pair := side_by_side.pair_of(named_runs, options.across):
            code = _show_pair(run, pair, options)
        elif options.across:
            raise InputError("--across compares two RUNs of one kind")
        else:
            if of_two := side_by_side.of_two_machines(named_runs):
                report = report_line if run.files else run.out.print
                report(of_two)
            elif not run.files and (reason := side_by_side.of_two_subjects(named_runs)):
                run.out.print(reason)
            _show_each(run, named_runs, options.code)
            code = _exit_code(stored, options, bool(of_two)) if options.findings else ExitCode.OK
        _name_files(run)
    run.exit_with(code)


def _name_files(run: RunContext) -> None:
    for file in run.files.values():
        if not file.is_stdout:
            run.out.print(f"Written: {file.name}", soft_wrap=True)


def _list(files: Sequence[Path], options: ShowOptions) -> None:
    from mjbench.commands.show import forms, reports, stored_runs
    from mjbench.results.content import Section
    from mjbench.results.json_form import ResultsDocument

    named_runs, numbers = [], []
    with RunContext(options, files) as run:
        for number, file in enumerate(files, 1):
            try:
                named_runs += reports.read([file])
                numbers.append(-number)
            except InputError as error:
                report_line(str(error))
        rows = stored_runs.stored_runs(numbers, named_runs)
        section = Section("Run files", tables=[stored_runs.table(rows)])
        if not run.files:
            run.table(stored_runs.table(rows))
        run.write_forms(
            forms.of_sections(command_line(), [section], ResultsDocument(results=rows), rows)
        )
        _name_files(run)


def _show_pair(run: RunContext, pair: "Sequence[NamedRun]", options: ShowOptions) -> int:
    """Show two runs side by side; return the exit code."""
    from mjbench.commands.show import forms, side_by_side
    from mjbench.commands.show.run_differences import RunDifference
    from mjbench.results.json_form import ResultsDocument

    if flags := sorted({*run.files} - _FORMS):
        raise InputError(f"{flags[0]} takes one RUN")
    old, new = (named.run for named in pair)
    rows = side_by_side.differences(old, new, options.across)
    sections = [side_by_side.section(pair, rows)]
    if not run.files:
        run.show(sections)
    run.write_forms(
        forms.of_sections(command_line(), sections, ResultsDocument(results=rows), rows)
    )
    timed = [row for row in rows if isinstance(row, RunDifference)]
    if options.findings and not timed:
        return _exit_code([old, new], options)
    code = options.exit_code_of_models([(row.model, row.verdict) for row in timed])
    return exit_code(row.status for row in timed) or code


def _show_each(run: RunContext, named_runs: "Sequence[NamedRun]", code: bool) -> None:
    from mjbench.commands.show import exports, forms

    stored = [named.run for named in named_runs]
    if not run.files:
        if len(stored) == 1:
            _print(run, stored[0], code)
        else:
            _print_several(run, stored, code)
        return
    for caution in exports.cautions(stored):
        report_line(caution)
    run.write_forms(forms.of_runs(named_runs))
    for flag, text_of in exports.BY_FLAG.items():
        if len(stored) > 1 and flag in run.files:
            raise InputError(f"{flag} takes one RUN")
        run.write(flag, functools.partial(text_of, stored[0]))


def _exit_code(
    stored: "Sequence[Run]", options: ShowOptions, are_of_two_machines: bool = False
) -> int:
    """Return the exit code that the verdicts of runs stand for, the worst one."""
    from mjbench.commands.versions import family
    from mjbench.paired.records import VerdictRecord

    judged = [run for run in stored if run.of_type(VerdictRecord)]
    if not judged and are_of_two_machines:
        return ExitCode.ENVIRONMENT
    if not judged:
        raise InputError(
            "--fail-on is about verdicts of `versions` and `ab`, or two runs of `compare` of one"
            " model"
        )

    def code(run: "Run") -> int:
        return options.exit_code_of_run(run, family.confidence_of(run.header))

    worst = max(judged, key=code)
    exit_code = code(worst)
    if len(stored) > 1 and exit_code != ExitCode.OK:
        report_line(f"exit code {exit_code}: mjbench {worst.header.typed_command}")
    return exit_code


def _print_several(run: RunContext, stored: "Sequence[Run]", code: bool) -> None:
    """Print what machines answer side by side, and each run after it."""
    from mjbench.commands.show import machine_comparison

    compared = machine_comparison.of_runs(stored)
    if compared.has_several:
        for line in compared.cautions:
            run.out.print(line, soft_wrap=True)
        run.show(filter(None, [machine_comparison.section(compared)]))
    for number, (each, machine) in enumerate(zip(stored, compared.identities, strict=True), 1):
        run.out.print()
        run.out.rule(f"Run {number} of {len(stored)}: {each.header.command} on {machine.name}")
        _print(run, each, code)


def _print(run: RunContext, stored: "Run", code: bool) -> None:
    from mjbench.commands.show import kinds

    if not stored.records:
        report_line("the run ended before anything was measured")
    run.show(kinds.kind_of(stored).sections(stored), code)
    run.hint_at_code()
