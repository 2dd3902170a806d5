"""`mjbench lint`: what makes a stepping loop slow or its log wrong."""

import sys
from pathlib import Path

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON
from mjbench.errors import InputError
from mjbench.status import ExitCode


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="FILE.py…")
@JSON
def lint(names: tuple[str, ...], json_file: str | None) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong, without executing it.

    Findings are FILE:LINE:COLUMN CODE MESSAGE, with roughly what it costs in each step; the exit
    code is 1 if there are any. A folder stands for all Python files below it. `# noqa: MJB001` at
    the end of a line suppresses its finding.
    """
    from mjbench.loop.lint import Finding, check, python_files
    from mjbench.report.lint import LintDocument, finding_line

    findings: list[Finding] = []
    unreadable: list[str] = []
    files = list(python_files(names))
    with RunContext("lint", json_file, inputs=[Path(file) for file in files]) as run:
        for file in files:
            try:
                findings += check(file)
            except InputError as error:
                unreadable.append(str(error))
        for finding in findings:
            click.echo(finding_line(finding), err=json_file == "-")
        run.write(LintDocument(findings=findings))
    for problem in unreadable:
        click.echo(f"mjbench: {problem}", err=True)
    if unreadable:
        sys.exit(ExitCode.USAGE)
    sys.exit(ExitCode.FINDING if findings else ExitCode.OK)
