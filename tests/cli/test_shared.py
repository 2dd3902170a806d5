"""The types of option values that several commands share."""

from typing import Any

import click
import pytest

from mjbench.cli.group import cli
from mjbench.cli.shared import Names, Numbers, Seconds, Share, Shares


@pytest.mark.parametrize(
    ("kind", "words", "value"),
    [
        (Numbers(), "1,2,4", [1, 2, 4]),
        (Numbers(), "2,2,1", [2, 1]),
        (Names(), "rollout, mjx", ["rollout", "mjx"]),
        (Share(), "1%", 0.01),
        (Share(), "0.5", 0.005),
        (Shares(), "0,0.5%,2", [0.0, 0.005, 0.02]),
        (Shares(), "150", [1.5]),
        (Seconds(), "60s", 60.0),
        (Seconds(), "0.5", 0.5),
        (Seconds(), 600.0, 600.0),
    ],
)
def test_words_become_values(kind: click.ParamType[Any], words: Any, value: Any) -> None:
    assert kind.convert(words, None, None) == value


@pytest.mark.parametrize(
    ("kind", "words", "message"),
    [
        (Numbers(), "1,two", "not a list of whole numbers"),
        (Numbers(), "0,1", "0 is below 1"),
        (Names(), ",", "no name given"),
        (Share(), "much", "not a percentage"),
        (Share(), "0", "not between 0% and 100%"),
        (Share(), "100%", "not between 0% and 100%"),
        (Share(), "nan", "not between 0% and 100%"),
        (Shares(), "0,tea", "not a list of percentages"),
        (Shares(), "-1", "at least 0%"),
        (Shares(), "inf", "at least 0%"),
        (Shares(), "nan", "at least 0%"),
        (Seconds(), "soon", "not a time such as 60s"),
        (Seconds(), "0s", "not above 0"),
        (Seconds(), "-1", "not above 0"),
        (Seconds(), "inf", "not above 0 and finite"),
        (Seconds(), "nan", "not above 0"),
    ],
)
def test_words_that_are_no_value_are_bad_usage(
    kind: click.ParamType[Any], words: str, message: str
) -> None:
    with pytest.raises(click.BadParameter, match=message):
        kind.convert(words, None, None)


def options_of_commands(flag: str) -> dict[str, click.Parameter]:
    """Return the option of that name of each command that has it."""
    return {
        name: parameter
        for name, command in cli.commands.items()
        for parameter in command.params
        if flag in parameter.opts
    }


def test_every_command_reads_a_time_limit_alike() -> None:
    options = options_of_commands("--time-limit")
    assert {"compare", "instructions", "versions"} <= set(options)
    assert {name for name, o in options.items() if not isinstance(o.type, Seconds)} == set()
