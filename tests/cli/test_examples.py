"""The examples in the help of commands: each is a command line that the command takes."""

import re
import shlex

import click
import pytest
from click_commands import COMMANDS

from mjbench.cli import cli


def examples(command: click.Command) -> list[str]:
    """Return the example lines of a command, without what a shell adds to them."""
    _, _, after = f"{command.help}{command.epilog}".partition("Example")
    lines = [line.strip() for line in after.splitlines()]
    shown = [line for line in lines if line.startswith("mjbench ")]
    return [re.split(r"\s(?:>>|&&|\||#)\s|\s{3,}", line)[0] for line in shown]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_takes_arguments_shows_an_example(name: str) -> None:
    command = COMMANDS[name]
    takes_arguments = any(isinstance(p, click.Argument) for p in command.params)
    if takes_arguments or name.count(" ") == 1 or "--" in name:
        assert examples(command) or isinstance(command, click.Group), name


@pytest.mark.parametrize(
    "line", sorted({line for c in (cli, *COMMANDS.values()) for line in examples(c)})
)
def test_an_example_is_parsed_by_its_command(line: str) -> None:
    words = cli.with_command(shlex.split(line)[1:])
    command: click.Command = cli
    context = click.Context(cli, **cli.context_settings)
    while isinstance(command, click.Group):
        _, found, words = command.resolve_command(context, words)
        assert found is not None
        command = found
        context = click.Context(command, parent=context)
        if not words and isinstance(command, click.Group):
            return
        if isinstance(command, click.Group) and words[0].startswith("-"):
            break
    try:
        command.make_context(command.name, words, parent=context)
    except click.exceptions.Exit as ended:  # it has answered, as `lint --rule` does
        assert ended.exit_code == 0
