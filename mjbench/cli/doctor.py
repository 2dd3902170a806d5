"""`mjbench doctor`: what on this machine spoils measurements."""

import time

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, command_line
from mjbench.cli.shared import takes
from mjbench.commands.doctor.options import DoctorOptions
from mjbench.status import ExitCode


@cli.command()
@takes(DoctorOptions)
def doctor(options: DoctorOptions) -> None:
    """What on this machine spoils measurements, and how small a change can it decide?

    It looks at the processor, its clock, the load, the host, Python, valgrind and rendering, and
    then compares the cart-pole with itself.

    Exit code: 1 if something is bad, or changes of 1 % cannot be decided within a minute; 3 if it
    could not measure.

    \b
    Example:
      mjbench doctor && mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower
    """
    from mjbench.commands.doctor.driver import CONDITIONS_S, all_conditions, compare_with_itself
    from mjbench.commands.doctor.show import condition_lines, noise_section
    from mjbench.commands.show import forms
    from mjbench.commands.show.documents import DoctorDocument
    from mjbench.host import machine, neighbours
    from mjbench.host.conditions import Grade
    from mjbench.results.content import Section
    from mjbench.results.terminal import print_lines

    budget = options.budget
    end_s = time.monotonic() + budget.whole_s
    with RunContext(options) as run:
        rows = all_conditions(neighbours.measuring_now())
        conditions = Section("This machine", facts=[*condition_lines(rows)])
        print_lines(run.out, conditions.facts)
        # the conditions of a busy machine take long: without a limit, they cost no launches
        usual_s = budget.each_s - CONDITIONS_S
        noise_s = usual_s if budget.total_s is None else end_s - time.monotonic()
        noise = compare_with_itself(noise_s)
        sections = [noise_section(noise, rows), conditions]
        run.show(sections[:1])
        document = DoctorDocument(machine=machine.describe(), conditions=rows, noise=noise)
        run.write_forms(forms.of_sections(command_line(), sections, document, [*rows, noise]))
    if noise.decidable is None:
        run.exit_with(ExitCode.ENVIRONMENT)
    is_fit = noise.trusted and all(row.grade != Grade.BAD for row in rows)
    run.exit_with(ExitCode.OK if is_fit else ExitCode.FINDING)
