"""`mjbench profile`: where a step's time goes; and what habits and functions of the engine cost."""

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import mode, models_argument, takes
from mjbench.commands.profile.options import HabitOptions, InstructionOptions, ProfileOptions
from mjbench.simulation.models import ModelSource


@cli.command()
@mode("--habits", "What does each habit of a Python loop cost?")
@mode("--instructions", "Count instructions by function; needs valgrind.")
@models_argument
@takes(ProfileOptions)
def profile(sources: list[ModelSource], options: ProfileOptions) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages, such as collision, constraint solver and kinematics, are from MuJoCo's own timers.
    Rendering is timed with EGL and with OSMesa, or on macOS with CGL. Steps are from states along
    a simulation of the model, or from those of --states, each with its controls held.

    \b
    Examples:
      mjbench profile humanoid
      mjbench profile robot.mjb --states states.npz
    """
    from mjbench.commands.profile.driver import measurement

    measure_and_print(measurement(sources, options), options).exit()


@cli.command("profile --habits")
@models_argument
@takes(HabitOptions)
def profile_habits(sources: list[ModelSource], options: HabitOptions) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    Every habit is timed inside a stepping loop, in turns with the bare loop, in several processes.
    Loops start from states along a simulation of the model, or from those of --states, and hold
    their controls.

    \b
    Examples:
      mjbench profile --habits cartpole
      mjbench profile --habits robot.mjb --states states.npz
    """
    from mjbench.commands.profile.driver import of_habits

    measure_and_print(of_habits(sources, options), options, code=options.code).exit()


@cli.command("profile --instructions")
@models_argument
@takes(InstructionOptions)
def profile_instructions(sources: list[ModelSource], options: InstructionOptions) -> None:
    """Count instructions per step, by function and stage; within 0.1 % the same on a busy machine.

    Needs valgrind. The first release draws start states and controls; every other one does the same
    work.

    \b
    Example:
      mjbench profile --instructions humanoid --releases 3.17.0,4.0.0
    """
    from mjbench.commands.profile.driver import of_instructions
    from mjbench.counts import show
    from mjbench.counts.records import InstructionsRecord

    measure_and_print(
        of_instructions(sources, options),
        options,
        summary=lambda run: show.sections(run.of_type(InstructionsRecord), options.top),
    ).exit()
