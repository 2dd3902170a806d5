"""`mjbench lint`: what makes a stepping loop slow or its log wrong."""

import sys

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import JSON
from mjbench.status import ExitCode, Status, exit_code


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="FILE…")
@JSON
def lint(names: tuple[str, ...], json_file: str | None) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong, without executing it.

    Findings are FILE:LINE:COLUMN CODE MESSAGE, with roughly what it costs in each step. FILE is a
    Python file, a Jupyter notebook, or a folder, which stands for all of them below it. `# noqa:
    MJB001` at the end of a line suppresses its finding.

    The exit code is 1 if there are findings; without any, 2 if a file could not be checked.

    \b
    Examples:
      mjbench lint train.py
      mjbench lint notebooks src
    """
    from mjbench.loop.lint import Finding, check_all
    from mjbench.loop.script_files import UncheckedFile, regular_files, script_files
    from mjbench.report.lint import LintDocument, finding_line

    findings: list[Finding] = []
    unchecked: list[UncheckedFile] = []
    files = script_files(names)
    with RunContext("lint", json_file, inputs=regular_files(files)) as run:
        for result in check_all(files):
            if isinstance(result, UncheckedFile):
                unchecked.append(result)
                report_line(f"{result.file}: {result.detail}")
            else:
                findings.append(result)
                run.out.print(finding_line(result), soft_wrap=True)
        run.write(LintDocument(findings=findings, unchecked=unchecked))
    if findings:
        sys.exit(ExitCode.FINDING)
    sys.exit(exit_code(Status.INPUT for _ in unchecked))
