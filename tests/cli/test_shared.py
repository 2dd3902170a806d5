"""What the command line says of texts that stand for no value."""

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from mjbench import options
from mjbench.cli.group import cli
from mjbench.cli.shared import Text
from mjbench.limits import Bounds
from mjbench.options import Kind


@pytest.mark.parametrize(
    ("kind", "words", "message"),
    [
        (options.numbers(), "1,two", "not a list of whole numbers"),
        (options.numbers(), "0,1", "each at least 1 and at most"),
        (options.NAMES, ",", "is not a name"),
        (options.SHARE, "much", "not a percentage"),
        (options.SHARE, "0", "above 0% and below 100%"),
        (options.SHARE, "100%", "above 0% and below 100%"),
        (options.SHARE, "0.5", r"below 100%: 0\.5% or 50%\?"),
        (options.SECONDS, "soon", "not a time such as 60s"),
        (options.SECONDS, "0s", "above 0 and at most 86400, a day"),
        (options.SECONDS, "inf", "at most 86400, a day in seconds"),
        (options.SECONDS_OR_ZERO, "-1", "at least 0 and"),
        (options.numbers(Bounds(1, 8)), "1,9", "at least 1 and at most 8"),
        (options.numbers(), str(10**30), "at most 2147483647"),
    ],
)
def test_words_that_are_no_value_are_bad_usage(kind: Kind, words: str, message: str) -> None:
    with pytest.raises(click.BadParameter, match=message):
        Text(kind).convert(words, None, None)


def options_of_commands(flag: str) -> dict[str, click.Parameter]:
    """Return the option of that name of each command that has it."""
    return {
        name: parameter
        for name, command in cli.commands.items()
        for parameter in command.params
        if flag in parameter.opts
    }


BUDGETS = {
    "checkup": ["cartpole"],
    "env": ["Humanoid-v5"],
    "compare": ["cartpole"],
    "tune": ["cartpole"],
    "versions": ["installed", "installed", "cartpole"],
    "versions --explain": ["installed", "installed", "cartpole"],
    "ab": ["path=rollout", "path=processes"],
    "bisect": ["3.3.0", "3.4.0", "cartpole"],
    "doctor": [],
    "profile": ["cartpole"],
    "profile --habits": ["cartpole"],
    "latency": ["cartpole"],
}


@pytest.mark.parametrize("command", BUDGETS)
def test_a_budget_is_of_the_whole_command_and_a_quick_form_is_one(command: str) -> None:
    words = [*command.split(" "), *BUDGETS[command]]
    help_text = " ".join(CliRunner().invoke(cli, [*words, "--help"]).output.split())
    assert "Time of the whole command" in help_text
    assert "A first impression, often uncertain: " in help_text
    assert "SECONDS is 60 or 60s; also with ms, us or min: 5ms." in help_text
    done = CliRunner().invoke(cli, [*words, "--quick", "--budget", "3s"])
    assert done.exit_code == 2
    assert done.stderr == "mjbench: --quick is a short --budget: give one of the two\n"


def number_options() -> Iterator[tuple[str, click.Option]]:
    """Return every option of every command that takes numbers."""
    text_types = (click.types.StringParamType, click.Path, click.Choice)
    for name, command in cli.commands.items():
        for parameter in command.params:
            has_value = isinstance(parameter, click.Option) and not parameter.is_flag
            is_text = isinstance(parameter.type, text_types)
            if has_value and not is_text and parameter.type.name not in ("NAME,…", "CODE,…"):
                yield f"{name} {parameter.opts[0]}", parameter


@pytest.mark.parametrize(
    "text", ["nan", "inf", "-inf", "-7", "1e300", "1" + 30 * "0", "9" * 5000, "", " ", "abc"]
)
def test_no_option_takes_a_number_that_makes_no_sense(text: str) -> None:
    for name, option in number_options():
        with pytest.raises(click.BadParameter) as refusal:
            option.type_cast_value(click.Context(cli), text)
            pytest.fail(f"{name} takes {text!r}")
        assert "\n" not in refusal.value.message
