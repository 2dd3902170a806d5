"""All commands of the command line, for tests of what they have in common."""

from collections.abc import Iterator

import click

from mjbench.cli import cli


def commands(group: click.Group, name: str = "mjbench") -> Iterator[tuple[str, click.Command]]:
    """Yield every command with its name, those of subgroups and modes, too."""
    for key, command in group.commands.items():
        yield f"{name} {key}", command
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} {key}")


COMMANDS = dict(commands(cli))
