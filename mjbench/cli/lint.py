"""`mjbench lint`: what makes a stepping loop slow or its log wrong."""

import contextlib
import sys
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import JSON
from mjbench.errors import InputError
from mjbench.status import ExitCode, Status, exit_code

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjbench.loop.script_files import UncheckedFile


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="FILE…")
@click.option(
    "--select",
    metavar="CODE,…",
    default="",
    help="Check only rules with these codes, or codes that begin so  [default: all]",
)
@click.option("--ignore", metavar="CODE,…", default="", help="Leave out rules, likewise.")
@click.option(
    "--output-format",
    "form",
    type=click.Choice(("text", "github", "json", "sarif")),
    default="text",
    show_default=True,
    help="github: annotations of GitHub Actions; sarif: for code scanning.",
)
@click.option(
    "--fix",
    is_flag=True,
    help="Change files: add .copy() to a view that is stored. Notebooks are left alone.",
)
@JSON
def lint(
    names: tuple[str, ...], select: str, ignore: str, form: str, fix: bool, json_file: str | None
) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong, without executing it.

    Findings are FILE:LINE:COLUMN CODE MESSAGE, with roughly what it costs in each step. FILE is a
    Python file, a Jupyter notebook, or a folder, which stands for all of them below it. `# noqa:
    MJB001` at the end of a line suppresses its finding.

    The exit code is 1 if there are findings; without any, 2 if a file could not be checked. With
    --fix, findings that were changed do not count.

    \b
    Examples:
      mjbench lint train.py
      mjbench lint notebooks src --ignore MJB006
      mjbench lint src --fix
      mjbench lint src --output-format sarif
    """
    from mjbench.loop.lint import Finding, check_all, codes
    from mjbench.loop.script_files import UncheckedFile, regular_files, script_files
    from mjbench.report.lint import FORMATS, LintDocument, finding_line

    if form != "text" and json_file == "-":
        raise InputError(f"--json - and --output-format {form} cannot share standard output")
    chosen = codes(_words(select), _words(ignore))
    findings: list[Finding] = []
    unchecked: list[UncheckedFile] = []
    files = script_files(names)
    with RunContext("lint", json_file, inputs=regular_files(files)) as run:
        if fix:
            _fix(files, chosen)
        for result in check_all(files, chosen):
            if isinstance(result, UncheckedFile):
                unchecked.append(result)
                report_line(f"{result.file}: {result.detail}")
            else:
                findings.append(result)
                if form == "text":
                    run.out.print(finding_line(result), soft_wrap=True)
        document = LintDocument(findings=findings, unchecked=unchecked)
        if form != "text":
            click.echo(FORMATS[form](document), nl=False)
        run.write(document)
    if findings:
        sys.exit(ExitCode.FINDING)
    sys.exit(exit_code(Status.INPUT for _ in unchecked))


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _fix(files: "Sequence[str | UncheckedFile]", codes: "Sequence[str]") -> None:
    """Change the files, and say how many findings they have no more."""
    from mjbench.loop import lint_fixes

    fixed = 0
    for file in files:
        if isinstance(file, str):
            with contextlib.suppress(InputError, RecursionError, MemoryError):  # the check says why
                fixed += lint_fixes.fix(file, codes)
    report_line(f"fixed {fixed} finding{'' if fixed == 1 else 's'}")
