"""`mjbench profile`: where a step's time goes; and what habits and functions of the engine cost."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    COUNTS_OUTPUT,
    LIMIT,
    LOOP_STARTS,
    SIZES,
    STORING,
    budget,
    mode,
    models_argument,
    seconds,
    with_options,
)


@cli.command()
@mode("--habits", "What does each habit of a Python loop cost?")
@mode("--instructions", "Count instructions by function; needs valgrind.")
@models_argument("cartpole")
@budget(4, "Time for the steps of each model, and half of it for the frames of each backend.")
@with_options(LOOP_STARTS, LIMIT, STORING)
def profile(output: OutputOptions, **options: Any) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages, such as collision, constraint solver and kinematics, are from MuJoCo's own timers.
    Rendering is timed with EGL and with OSMesa, or on macOS with CGL. Steps are short runs from
    states along the model's own run, or from those of --states, each with its controls held.
    Without a MODEL: cartpole.

    \b
    Examples:
      mjbench profile humanoid
      mjbench profile robot.mjb --states states.npz
    """
    from mjbench.api.profile import measurement

    measure_and_print(measurement(**options), output).exit()


@cli.command("profile --habits")
@models_argument("cartpole")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@budget(30, "About how long to time the habits of each model.")
@with_options(LOOP_STARTS, LIMIT, STORING)
def profile_habits(code: bool, output: OutputOptions, **options: Any) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    Every habit is timed inside a stepping loop, in turns with the bare loop, in several processes.
    Loops start from states along the model's own run, or from those of --states, and hold their
    controls.
    Without a MODEL: cartpole.

    \b
    Examples:
      mjbench profile --habits cartpole
      mjbench profile --habits robot.mjb --states states.npz
    """
    from mjbench.api.profile import of_habits

    measure_and_print(of_habits(**options), output, code=code).exit()


@cli.command("profile --instructions")
@models_argument()
@click.option(
    "--release",
    "releases",
    multiple=True,
    metavar="RELEASE",
    help="Release to count in; may be given several times.  [default: installed]",
)
@click.option("--top", type=COUNT, default=15, show_default=True, help="List this many functions.")
@click.option(
    "--time-limit",
    "limit_s",
    type=seconds(),
    default="600s",
    show_default=True,
    help="Kill a release's process that finishes no model for this long.",
)
@with_options(SIZES, COUNTS_OUTPUT)
def profile_instructions(top: int, output: OutputOptions, **options: Any) -> None:
    """Count instructions per step, by function and stage; within 0.1 % the same on a busy machine.

    Needs valgrind. The first RELEASE draws start states and controls; every other one does the same
    work. Without a MODEL: all shipped models.

    \b
    Example:
      mjbench profile --instructions humanoid --release 3.3.0 --release 4.0.0
    """
    from mjbench.api.profile import of_instructions
    from mjbench.counts import show as counts
    from mjbench.counts.records import InstructionsRecord

    measure_and_print(
        of_instructions(**options),
        output,
        summary=lambda run: counts.sections(run.of_type(InstructionsRecord), top),
    ).exit()
