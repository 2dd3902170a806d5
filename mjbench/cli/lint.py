"""`mjbench lint`: what makes a stepping loop slow or its log wrong."""

import sys

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import JSON
from mjbench.errors import InputError, printable
from mjbench.status import ExitCode, Status, exit_code
from mjbench.units import count_of


def _explain(context: click.Context, _: click.Parameter, code: str | None) -> None:
    if code is not None:
        from mjbench.loop.lint_rules import explained

        click.echo(explained(code), nl=False)
        context.exit()


@cli.command()
@click.argument("names", nargs=-1, metavar="FILE…")
@click.option(
    "--select",
    metavar="CODE,…",
    default="",
    help="Check only rules with these codes or prefixes of codes.  [default: as in"
    " pyproject.toml, else all]",
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
    help="Change files: add .copy() to a view that is stored, and take named access out of a loop.",
)
@click.option("--diff", is_flag=True, help="Print what --fix would change, and change nothing.")
@click.option(
    "--statistics", is_flag=True, help="Print the number of findings of each rule instead."
)
@click.option(
    "--explain",
    metavar="CODE",
    callback=_explain,
    expose_value=False,
    is_eager=True,
    help="Print what a rule finds, why, and what to write instead, and end; `all` lists the rules.",
)
@JSON
def lint(
    names: tuple[str, ...],
    select: str,
    ignore: str,
    form: str,
    fix: bool,
    diff: bool,
    statistics: bool,
    json_file: str | None,
) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong, without executing it.

    It finds stored views (`log.append(data.qpos)` without .copy()), models, MjData and renderers
    that a loop makes anew, names that it looks up in each step, and more: `--explain all` lists the
    rules.

    Findings are FILE:LINE:COLUMN CODE MESSAGE, with roughly what it costs in each step. FILE is a
    Python file, a Jupyter notebook, or a folder, which stands for all of them below it. `# noqa:
    MJB001` at the end of a line suppresses its finding. `[tool.mjbench.lint]` in pyproject.toml has
    `select`, `ignore` and `per-file-ignores`.

    --fix changes a file where this is certainly safe, and prints on standard error why it leaves
    others of these findings.

    The exit code is 1 if there are findings; without any, 2 if a file could not be checked. With
    --fix, findings that were changed do not count, and it is 3 if a file could not be written. With
    --diff, it is 1 if --fix would change a file.

    \b
    Examples:
      mjbench lint train.py
      mjbench lint notebooks src --ignore MJB006
      mjbench lint src --diff
      mjbench lint src --fix
      mjbench lint src --output-format sarif
      mjbench lint --explain MJB007
    """
    from mjbench.loop.lint import Finding
    from mjbench.loop.lint_fixes import lint_all
    from mjbench.loop.lint_settings import RuleChoice
    from mjbench.loop.script_files import UncheckedFile, regular_files, script_files
    from mjbench.report import lint as report

    if not names:
        raise InputError("no file or folder is given; for this folder: mjbench lint .")
    if form != "text" and json_file == "-":
        raise InputError(f"--json - and --output-format {form} cannot share standard output")
    if diff and (form != "text" or json_file is not None):
        raise InputError("--diff prints a diff alone: use it without --json and --output-format")
    if statistics and (form != "text" or diff):
        raise InputError("--statistics prints counts alone: use it without --output-format, --diff")
    choice = RuleChoice(_split(select), _split(ignore))
    files = script_files(names)
    for file in files:
        if isinstance(file, str):
            choice.codes_for(file)  # refuses settings before anything is printed or changed
    findings: list[Finding] = []
    unchecked: list[UncheckedFile] = []
    fixed, is_unwritten = 0, False
    with RunContext(json_file, regular_files(files)) as run:
        for result in lint_all(files, choice, fixes=fix or diff, writes=fix and not diff):
            if isinstance(result, UncheckedFile):
                unchecked.append(result)
                report_line(f"{result.file}: {result.detail}")
                continue
            if result.problem:
                is_unwritten = True
                report_line(result.problem)
            fixed += result.fixed
            if diff:
                click.echo(_shown(result.diff()), nl=False)
            else:
                findings += result.findings
            if form == "text" and not statistics and not diff:
                for finding in result.findings:
                    run.out.print(report.finding_line(finding), soft_wrap=True)
            for unfixed in result.unfixed:
                report_line(report.unfixed_line(unfixed))
        document = report.LintDocument(findings=findings, unchecked=unchecked)
        for line in report.statistics_lines(findings) if statistics else ():
            run.out.print(line, soft_wrap=True)
        if form != "text":
            click.echo(report.FORMATS[form](document), nl=False)
        run.write(document)
    if fix or diff:
        report_line(f"{'would fix' if diff else 'fixed'} {count_of(fixed, 'finding')}")
    if is_unwritten:
        sys.exit(ExitCode.ENVIRONMENT)
    if findings or (diff and fixed):
        sys.exit(ExitCode.FINDING)
    sys.exit(exit_code(Status.INPUT for _ in unchecked))


def _split(text: str) -> tuple[str, ...]:
    return tuple(code.strip() for code in text.split(",") if code.strip())


def _shown(diff: str) -> str:
    """Return a diff as it is, but for a terminal, which control characters in it would change."""
    if not sys.stdout.isatty():
        return diff
    lines = ("\t".join(map(printable, line.split("\t"))) for line in diff.split("\n"))
    return "\n".join(lines)
