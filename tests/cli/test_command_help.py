"""One grammar: an option of several commands is the same in all, and help has it in one place."""

import re
from collections import defaultdict
from dataclasses import dataclass

import click
import pytest
from click_commands import COMMANDS

from mjbench.cli.command_help import HEADINGS

# Options whose default is of the command, such as a time.
OTHER_DEFAULTS = {"--budget", "--hold", "--nbatch", "--nstep", "--results", "--time-limit"}
# Options that are a list in some commands, which measure each of its values.
LISTS = {"--nbatch"}
# Options whose text has the names, the things or the time of the command, and how all begin.
BEGINNINGS = {
    "--budget": "Time of the whole command",
    "--fail-on": "Exit 1 for one of these: ",
    "--nbatch": "Simulations at once",
    "--nstep": "Steps ",
    "--only": "Try only these ",
    "--paths": "Ways of stepping to compare",
    "--quick": "A first impression, often uncertain: ",
    "--skip": "Leave out these ",
    "--threads": "Thread counts",
}
# The options that choose what is done and what is not; those of lint are named as by ruff.
INCLUSIONS, EXCLUSIONS = {"--only", "--select"}, {"--skip", "--ignore"}


@dataclass(frozen=True)
class Entry:
    """An option, as the help of a command has it."""

    kind: str
    sentence: str
    default: str


def entries() -> dict[str, dict[str, Entry]]:
    """Return the entry of each option in each command that has it."""
    by_flag: dict[str, dict[str, Entry]] = defaultdict(dict)
    for name, command in COMMANDS.items():
        for option in command.params:
            if isinstance(option, click.Option):
                names, text = option.get_help_record(click.Context(command)) or ("", "")
                sentence, _, default = text.partition("  [default: ")
                entry = Entry(names.partition(" ")[2], sentence, default)
                by_flag[option.opts[-1]][name] = entry
    return by_flag


ENTRIES = entries()
SHARED = sorted(flag for flag, of_commands in ENTRIES.items() if len(of_commands) > 1)


def variants(flag: str, part: str) -> set[str]:
    return {getattr(entry, part) for entry in ENTRIES[flag].values()}


@pytest.mark.parametrize("flag", SHARED)
def test_an_option_has_one_kind_sentence_and_default_in_all_commands(flag: str) -> None:
    kinds, sentences = variants(flag, "kind"), variants(flag, "sentence")
    assert len(kinds) == 1 or (flag in LISTS and kinds == {"N", "N,N,…"})
    if flag in BEGINNINGS:
        assert all(sentence.startswith(BEGINNINGS[flag]) for sentence in sentences)
    else:
        assert len(sentences) == 1
        assert len(variants(flag, "default")) == 1 or flag in OTHER_DEFAULTS


def test_what_may_differ_does() -> None:
    assert {flag for flag in LISTS if len(variants(flag, "kind")) == 1} == set()
    assert {flag for flag in OTHER_DEFAULTS if len(variants(flag, "default")) == 1} == set()


def test_what_is_done_and_what_is_left_out_is_a_list_of_names() -> None:
    for flag in INCLUSIONS | EXCLUSIONS:
        assert variants(flag, "kind") <= {"NAME,…", "CODE,…"}
    for flag in EXCLUSIONS:
        assert all(sentence.startswith("Leave out ") for sentence in variants(flag, "sentence"))
    for flag in INCLUSIONS:
        assert all(" only " in sentence for sentence in variants(flag, "sentence"))
    assert [flag for flag in ENTRIES if re.match("--(no|without|exclude|include)-?", flag)] == []
    assert "--no-" not in "".join(entry.kind for of in ENTRIES.values() for entry in of.values())


@pytest.mark.parametrize("name", [n for n, c in COMMANDS.items() if not isinstance(c, click.Group)])
def test_help_has_a_commands_own_options_before_the_shared_ones(name: str) -> None:
    command = COMMANDS[name]
    lines = command.get_help(click.Context(command, info_name=name)).splitlines()
    headings = {f"{heading}:": heading for heading in ("Options", *HEADINGS)}
    order = [headings[line] for line in lines if line in headings]
    assert order == [heading for heading in headings.values() if heading in order]
    heading = ""
    for line in lines:
        heading = headings.get(line, heading)
        if heading and (flag := re.match(r"  (?:-\w, )?(--[\w-]+)", line)):
            places = [each for each, flags in HEADINGS.items() if flag[1] in flags]
            assert [heading] == (places or ["Options"]), line


def test_every_option_under_a_heading_is_of_a_command() -> None:
    flags = {flag for under in HEADINGS.values() for flag in under}
    assert flags - set(ENTRIES) == {"--help"}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_written_in_one_way(name: str) -> None:
    command = COMMANDS[name]
    text = command.get_help(click.Context(command, info_name=name, terminal_width=1000))
    assert "..." not in text
    assert {before[-1] for before in re.findall(r"(\S+)  \[default: ", text)} <= {"."}


@pytest.mark.parametrize("name", ["checkup", "compare", "doctor", "lint", "run"])
def test_help_has_the_exit_codes_of_a_command_that_differ_from_the_general_ones(name: str) -> None:
    assert "Exit code: " in (COMMANDS[f"mjbench {name}"].help or "")
