"""Which commands the help lists, and modes of commands."""

import re

import click
import pytest
from click.testing import CliRunner

from mjbench.cli import cli
from mjbench.command_names import LISTED, command_of, with_mode
from mjbench.commands.show.kinds import KINDS

MODES = sorted(name for name in cli.commands if " --" in name)


def test_the_help_lists_every_command_once() -> None:
    listed = [name for lines in LISTED.values() for name in lines]
    assert sorted(listed) == sorted(set(cli.commands) - set(MODES))


def test_the_help_fits_on_a_screen() -> None:
    done = CliRunner().invoke(cli, ["--help"], env={"COLUMNS": "80"}, terminal_width=80)
    lines = done.output.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize("words", [["help", "help"], ["help", "--help"], ["help"]], ids=" ".join)
def test_help_of_help_is_the_first_screen(words: list[str]) -> None:
    assert CliRunner().invoke(cli, words).output == CliRunner().invoke(cli, ["--help"]).output


def test_the_first_screen_says_how_long_a_command_takes_by_default() -> None:
    takes = {name: each.takes for of in LISTED.values() for name, each in of.items() if each.takes}
    for name, text in takes.items():
        command = cli.commands[name]
        (option,) = [o for o in command.params if {"--budget", "--seconds"} & {*o.opts}][:1]
        _, help_text = option.get_help_record(click.Context(command))
        (seconds,) = re.findall(r"default: (\d+)s", help_text)
        whole = f"{seconds} s", f"{int(seconds) / 60:g} min"
        assert text in (whole if name != "bisect" else ("minutes",)), name  # of several verdicts
    assert takes.keys() == {
        name for name in takes.keys() | set(cli.commands) - set(MODES)
        if any({"--budget", "--seconds"} & {*o.opts} for o in cli.commands[name].params)
    }  # fmt: skip


@pytest.mark.parametrize("words", [[], *([name] for name, c in cli.commands.items()
                                        if isinstance(c, click.Group))], ids=" ".join)  # fmt: skip
def test_the_help_has_a_line_for_each_command_in_a_narrow_terminal(words: list[str]) -> None:
    done = CliRunner().invoke(cli, [*words, "--help"], env={"COLUMNS": "60"}, terminal_width=60)
    lists = re.split(r"\n(?:What to change|Commands):\n", done.output)[1].split("\n\n")[0]
    lines = [line for line in lists.splitlines() if line.startswith("  ")]
    assert len(lines) >= 2
    for line in lines:
        assert re.match(r"  \w+ +\S.*[^.]$", line), line
        assert len(line) <= 60, line


@pytest.mark.parametrize("name", MODES)
def test_a_mode_is_an_option_of_its_command(name: str) -> None:
    command, flag = name.split()
    assert flag in [option for p in cli.commands[command].params for option in p.opts]


@pytest.mark.parametrize("name", MODES)
def test_the_help_of_a_mode_is_its_own_wherever_the_flag_stands(name: str) -> None:
    command, flag = name.split()
    for words in ([command, flag, "--help"], [command, "cartpole", "--help", flag]):
        done = CliRunner().invoke(cli, words)
        assert f" {name} [OPTIONS]" in done.output


def test_what_follows_a_separator_is_no_mode() -> None:
    assert with_mode(["versions", "--", "--explain"], MODES) == ["versions", "--", "--explain"]


@pytest.mark.parametrize("name", [name for kind in KINDS for name in kind.commands])
def test_documents_and_runs_are_said_to_be_of_commands(name: str) -> None:
    command, *rest = command_of(name).split()
    group = cli.commands[command]
    options = {option for parameter in group.params for option in parameter.opts}
    subcommands = group.commands if isinstance(group, click.Group) else {}
    assert {*rest} <= {*options, *subcommands}


@pytest.mark.parametrize("name", ["show", "doctor", "sweep", *(
    name for name in cli.commands
    if {"resume", "wait"} & {parameter.name for parameter in cli.commands[name].params}
)])  # fmt: skip
def test_what_measures_or_shows_writes_the_same_files(name: str) -> None:
    flags = {option for parameter in cli.commands[name].params for option in parameter.opts}
    assert {"--html", "--markdown", "--csv", "--json"} <= flags
