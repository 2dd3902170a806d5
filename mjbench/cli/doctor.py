"""`mjbench doctor`: what on this machine spoils measurements."""

import sys

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, budget, mode
from mjbench.status import ExitCode


@cli.command()
@mode("--verdicts", "How often are verdicts wrong on this machine?")
@mode("--placement", "How far does speed depend on where MuJoCo's code lies in memory?")
@budget(12, "Time for comparing the cart-pole with itself.")
@JSON
def doctor(budget_s: float, json_file: str | None) -> None:
    """What on this machine spoils measurements, and how small a change can it decide?

    It looks at the processor, its clock, the load, the host, Python, valgrind and rendering, and
    then compares the cart-pole with itself. Exit code 1: something is bad, or changes of 1 %
    cannot be decided within a minute. --verdicts and --placement take its place, and
    much longer.

    \b
    Example:
      mjbench doctor && mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower
    """
    from mjbench.api import doctor
    from mjbench.host import machine
    from mjbench.host.conditions import Grade
    from mjbench.host.neighbours import Presence
    from mjbench.pages.terminal import print_lines
    from mjbench.report.doctor import condition_lines, noise_section
    from mjbench.report.documents import DoctorDocument

    with Presence("doctor") as presence, RunContext(json_file) as run:
        rows = doctor.all_conditions(presence.enter(wait=False))
        print_lines(run.out, [*condition_lines(rows)])
        noise = doctor.noise(budget_s)
        run.show([noise_section(noise, rows)])
        run.write(DoctorDocument(machine=machine.describe(), conditions=rows, noise=noise))
    if noise.decidable is None:
        sys.exit(ExitCode.ENVIRONMENT)
    is_fit = noise.trusted and all(row.grade != Grade.BAD for row in rows)
    sys.exit(ExitCode.OK if is_fit else ExitCode.FINDING)
