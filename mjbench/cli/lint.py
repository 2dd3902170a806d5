"""`mjbench lint`: what makes a stepping loop slow or its log wrong."""

import sys

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import FileName, takes
from mjbench.commands.lint.options import LintOptions
from mjbench.errors import InputError
from mjbench.formats import count_of
from mjbench.status import ExitCode, Status, exit_code


def _print_rule(context: click.Context, _: click.Parameter, code: str | None) -> None:
    if code is not None:
        from mjbench.commands.lint.rules import explained

        click.echo(explained(code), nl=False)
        context.exit()


@cli.command()
@click.argument("names", nargs=-1, metavar="[FILE]…", type=FileName())
@click.option(
    "--rule",
    metavar="CODE",
    callback=_print_rule,
    expose_value=False,
    help="Print what a rule finds, why, and what to write instead, and end; `all` lists the rules.",
)
@takes(LintOptions)
def lint(names: tuple[str, ...], options: LintOptions) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong, without executing it.

    It finds stored views (`log.append(data.qpos)` without .copy()), models, MjData and renderers
    that a loop makes again, names that it looks up in each step, and more: `--rule all` lists the
    rules.

    Findings are FILE:LINE:COLUMN CODE MESSAGE, with roughly what it costs in each step. FILE is a
    Python file, or a folder, which stands for all of them below it. `# noqa: MJB001` at the end of
    a line suppresses its finding. `[tool.mjbench.lint]` in pyproject.toml has `select`, `ignore`
    and `per-file-ignores`.

    Exit code: 1 if there are findings; without any, 2 if a file could not be checked.

    \b
    Examples:
      mjbench lint train.py
      mjbench lint src --ignore MJB006
      mjbench lint src --sarif lint.sarif
      mjbench lint --rule MJB007
    """
    from mjbench.commands.lint import show as report
    from mjbench.commands.lint.check import Finding, check_all
    from mjbench.commands.lint.script_files import UncheckedFile, regular_files, script_files
    from mjbench.commands.lint.settings import RuleChoice

    if not names:
        raise InputError("no file or folder is given; for this folder: mjbench lint .")
    choice = RuleChoice(tuple(options.select or ()), tuple(options.ignore or ()))
    files = script_files(names)
    for file in files:
        if isinstance(file, str):
            choice.codes_for(file)  # refuses settings before anything is printed
    findings: list[Finding] = []
    unchecked: list[UncheckedFile] = []
    with RunContext(options, regular_files(files)) as run:
        for result in check_all(files, choice):
            if isinstance(result, UncheckedFile):
                unchecked.append(result)
                report_line(f"{result.file}: {result.detail}")
                continue
            findings += result
            for finding in () if options.statistics else result:
                run.out.print(report.finding_line(finding), soft_wrap=True)
        document = report.LintDocument(findings=findings, unchecked=unchecked)
        for line in report.statistics_lines(findings) if options.statistics else ():
            run.out.print(line, soft_wrap=True)
        run.write("--github", lambda: report.as_github(document))
        run.write("--sarif", lambda: report.as_sarif(document))
        run.write_json(document)
        if not (findings or unchecked):
            run.out.print(f"No findings in {count_of(len(files), 'file')}.")
    if findings:
        sys.exit(ExitCode.FINDING)
    sys.exit(exit_code(Status.INPUT for _ in unchecked))
