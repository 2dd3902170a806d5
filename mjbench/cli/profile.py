"""`mjbench profile`: where a step's time goes."""

from typing import Any

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    LIMIT,
    LOOP_STARTS,
    STORING,
    budget,
    mode,
    models_argument,
    with_options,
)


@cli.command()
@mode("--habits", "What does each habit of a Python loop cost?")
@mode("--instructions", "Count instructions by function; needs valgrind.")
@models_argument("cartpole")
@budget(4, "Time for the steps of each model, and half of it for the frames of each backend.")
@with_options(LOOP_STARTS, LIMIT, STORING)
def profile(time_limit: float, output: OutputOptions, **options: Any) -> None:
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

    measure_and_print(measurement(**options, limit_s=time_limit), output).exit()
