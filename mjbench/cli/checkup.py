"""`mjbench checkup`, and `mjbench TARGET`: what to do about a simulation that is slow."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import show_pages
from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.shared import CODE, LIMIT, LOOP_STARTS, OUTPUT, budget, with_options

if TYPE_CHECKING:
    from mjbench.simulation.starts import StartPlan


@cli.command()
@click.argument("target", metavar="TARGET")
@click.argument("arguments", nargs=-1, metavar="[-- ARGS…]", type=click.UNPROCESSED)
@click.option(
    "--quick", is_flag=True, help="Take 15 seconds, whatever --budget is, and try no settings."
)
@budget(60, "Time in all; a program runs for two thirds of it.")
@click.option("--html", "html_file", metavar="FILE", help="Also write the report as an HTML page.")
@click.option(
    "--markdown", "markdown_file", metavar="FILE|-", help="Also write the report as Markdown."
)
@CODE
@with_options(LOOP_STARTS, LIMIT, OUTPUT)
def checkup(
    target: str,
    arguments: tuple[str, ...],
    quick: bool,
    budget_s: float,
    html_file: str | None,
    markdown_file: str | None,
    code: bool,
    starts: "StartPlan",
    limit_s: float,
    output: OutputOptions,
) -> None:
    """My simulation is slow: what can I do? One ranked list, in a minute.

    TARGET is a model, a Python program or an environment, as other commands take them. `mjbench
    TARGET` is the same. For a model, it races ways of stepping, tries settings, and measures
    together the changes that keep results. A program runs unchanged, and its arguments follow --.
    What it prints stays on standard output; the list goes to standard error. Where it fails,
    its exit code is that of the check-up.

    Each item shows what it gains, what it changes in results, and which command looks closer. Wrong
    results come first.

    \b
    Examples:
      mjbench robot.xml
      mjbench train.py -- --num-envs 4
      mjbench Humanoid-v5 --quick
      mjbench my_env:make --html checkup.html
    """
    from mjbench.api.checkup import CheckupPlan, measurement
    from mjbench.api.run import exit_code_of
    from mjbench.commands.checkup import show as report
    from mjbench.commands.checkup import targets
    from mjbench.commands.show.reports import NamedRun

    source = targets.recognized(target, arguments, Path.cwd())
    work = measurement(source, CheckupPlan(quick, starts, limit_s, budget_s))
    pages = {
        form: OutputFile(f"--{form}", name, work.files)
        for form, name in (("html", html_file), ("markdown", markdown_file))
    }
    with contextlib.ExitStack() as closing:
        for page in pages.values():
            closing.callback(page.close)
            page.open()
        run = measure_and_print(
            work,
            output,
            each=report.part_sections,
            summary=report.summary,
            code=code,
            has_results=False,  # parts are printed as they end
            to_stderr=isinstance(source, targets.ProgramFile) or markdown_file == "-",
        )
        named = NamedRun(run.session.file or output.results, run.session.run())
        for form, page in pages.items():
            if page.is_wanted:
                page.write(show_pages.page(form, [named]))
    if code_of_program := exit_code_of(run.session.run()):
        run.exit_with(code_of_program)
    run.exit()
