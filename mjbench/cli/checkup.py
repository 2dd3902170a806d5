"""`mjbench checkup`, and `mjbench TARGET`: what to do about a simulation that is slow."""

from pathlib import Path

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import ProgramCommand, takes
from mjbench.command_names import NAMES
from mjbench.commands.checkup.options import CheckupOptions
from mjbench.errors import InputError


class _TargetCommand(ProgramCommand):
    """A command whose TARGET may be a program; a model or an environment has no arguments."""

    def is_program(self, word: str) -> bool:
        from mjbench.commands.checkup.targets import is_program

        return is_program(word)


@cli.command(cls=_TargetCommand)
@click.argument("target", metavar="TARGET")
@click.argument("arguments", nargs=-1, metavar="[ARGS]…", type=click.UNPROCESSED)
@takes(CheckupOptions)
def checkup(target: str, arguments: tuple[str, ...], options: CheckupOptions) -> None:
    """My simulation is slow: what can I do? One ranked list, in a minute.

    TARGET is a model, a Python program or an environment, as other commands take them. `mjbench
    TARGET` is the same. For a model, it races ways of stepping, tries settings, and measures
    together the changes that keep results; --settle and --states are of models only. A program is
    taken as by `mjbench run`: options of mjbench come before it, its arguments follow it, and it
    runs unchanged, until --seconds or a --budget end it. The list then goes to standard error.

    Each item shows what it gains, what it changes in results, and which command looks closer. Wrong
    results come first.

    Exit code: the program's, if it fails; 2 if MuJoCo refuses its model.

    \b
    Examples:
      mjbench robot.xml
      mjbench train.py --num-envs 8
      mjbench --seconds none -m package.train
      mjbench Humanoid-v5 --quick
      mjbench my_env:make --html checkup.html
    """
    from mjbench.commands.checkup import show, targets
    from mjbench.commands.checkup.driver import CheckupPlan, measurement
    from mjbench.commands.run.driver import exit_code_of

    if target in NAMES:
        raise InputError(f"options of a command follow its name: mjbench {target} …")
    source = targets.recognized(target, arguments, Path.cwd())
    run = measure_and_print(
        measurement(source, CheckupPlan.of(options)),
        options,
        each=show.part_sections,
        summary=show.summary,
        code=options.code,
        to_stderr=isinstance(source, targets.ProgramFile),
    )
    if code_of_program := exit_code_of(run.session.run()):
        run.exit_with(code_of_program)
    run.exit()
