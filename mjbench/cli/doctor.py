"""`mjbench doctor`: what on this machine spoils measurements, and what verdicts are worth here."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, RunContext, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    JSON,
    SHARES,
    STORING,
    TRIAL_PLAN,
    budget,
    mode,
    with_options,
)
from mjbench.simulation import engine_library
from mjbench.status import ExitCode


@cli.command()
@mode("--verdicts", "How often are verdicts wrong on this machine?")
@budget(12, "Time for comparing the cart-pole with itself.")
@JSON
def doctor(budget_s: float, json_file: str | None) -> None:
    """What on this machine spoils measurements, and how small a change can it decide?

    It looks at the processor, its clock, the load, the host, Python, valgrind and rendering, and
    then compares the cart-pole with itself. Exit code 1: something is bad, or changes of 1 %
    cannot be decided within a minute. --verdicts takes its place, and much
    longer.

    \b
    Example:
      mjbench doctor && mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower
    """
    from mjbench.api.doctor import all_conditions, compare_with_itself
    from mjbench.host import machine, neighbours
    from mjbench.host.conditions import Grade
    from mjbench.pages.terminal import print_lines
    from mjbench.report.doctor import condition_lines, noise_section
    from mjbench.report.documents import DoctorDocument

    with RunContext(json_file) as run:
        rows = all_conditions(neighbours.measuring_now())
        print_lines(run.out, [*condition_lines(rows)])
        noise = compare_with_itself(budget_s)
        run.show([noise_section(noise, rows)])
        run.write(DoctorDocument(machine=machine.describe(), conditions=rows, noise=noise))
    if noise.decidable is None:
        run.exit_with(ExitCode.ENVIRONMENT)
    is_fit = noise.trusted and all(row.grade != Grade.BAD for row in rows)
    run.exit_with(ExitCode.OK if is_fit else ExitCode.FINDING)


@cli.command("doctor --verdicts")
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--trials",
    "count",
    type=COUNT,
    default=20,
    show_default=True,
    help="Comparisons for each row of the table.",
)
@click.option(
    "--slowdowns",
    type=SHARES,
    help="Slowdowns to inject: by how much longer each block of the candidate lasts; 0 compares"
    " identical targets  [default: 0,0.5,1,2,5; none with --inside-step or --between-builds]",
)
@click.option(
    "--inside-step",
    "functions",
    type=click.Choice(list(engine_library.FUNCTIONS)),
    multiple=True,
    metavar="FUNCTION",
    help="Slow the candidate down inside mj_step, by one more call of this C function of MuJoCo:"
    f" {', '.join(engine_library.FUNCTIONS)}. Can be given several times.",
)
@click.option(
    "--between-builds",
    is_flag=True,
    help="Compare releases whose steps execute equally many instructions, which should be `same`.",
)
@click.option("--busy", "is_busy", is_flag=True, help="Keep the last core busy during the trials.")
@with_options(TRIAL_PLAN, STORING)
def doctor_verdicts(output: OutputOptions, **options: Any) -> None:
    """How often are verdicts wrong or undecided on this machine, now, and how long do they take?

    Compares the installed release with itself, with a slowdown of known size injected or none, and
    reports false alarms, power, the error of the estimate, and seconds per verdict. As between
    releases, the machine code of both targets is moved from launch to launch, unless --as-shipped
    is given.

    Without a MODEL: cartpole and humanoid, and all shipped models for --between-builds.

    \b
    Examples:
      mjbench doctor --verdicts
      mjbench doctor --verdicts cartpole --slowdowns 0,1 --trials 20
    """
    from mjbench.api.doctor import trials

    measure_and_print(trials(**options), output, at_end=True).exit()
