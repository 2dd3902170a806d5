"""The types of option values that several commands share."""

import math
from collections.abc import Iterator
from typing import Any

import click
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench import limits
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    HERTZ,
    LARGE_COUNT,
    NAMES,
    count,
    numbers,
    seconds,
    share,
)
from mjbench.limits import COUNT, MAX_SECONDS, THREADS, Bounds


@pytest.mark.parametrize(
    ("kind", "words", "value"),
    [
        (numbers(), "1,2,4", [1, 2, 4]),
        (numbers(), "2,2,1", [2, 1]),
        (NAMES, "rollout, mjx", ["rollout", "mjx"]),
        (share(), "1%", 0.01),
        (share(), "0.5", 0.005),
        (share(below=math.inf), "250", 2.5),
        (seconds(), "60s", 60.0),
        (seconds(), "0.5", 0.5),
        (seconds(), "1ms", 0.001),
        (seconds(), "500us", 0.0005),
        (LARGE_COUNT, "1e9", 10**9),
        (HERTZ, "500Hz", 500.0),
        (seconds(), 600.0, 600.0),
        (seconds(zero=True), "0", 0.0),
    ],
)
def test_words_become_values(kind: click.ParamType[Any], words: Any, value: Any) -> None:
    assert kind.convert(words, None, None) == value


@pytest.mark.parametrize(
    ("kind", "words", "message"),
    [
        (numbers(), "1,two", "not a list of whole numbers"),
        (numbers(), "0,1", "each at least 1 and at most"),
        (NAMES, ",", "is not a name"),
        (share(), "much", "not a percentage"),
        (share(), "0", "above 0% and below 100%"),
        (share(), "100%", "above 0% and below 100%"),
        (share(), "nan", "above 0% and below 100%"),
        (seconds(), "soon", "not a time such as 60s"),
        (seconds(), "0s", "above 0 and at most 86400, a day"),
        (seconds(), "-1", "above 0 and at most 86400, a day"),
        (seconds(), "inf", "at most 86400, a day in seconds"),
        (seconds(), "1e300", "at most 86400, a day in seconds"),
        (seconds(zero=True), "-1", "at least 0 and"),
        (numbers(Bounds(1, 8)), "1,9", "at least 1 and at most 8"),
        (numbers(), str(10**30), "at most 2147483647"),
        (seconds(), "nan", "above 0 and at most 86400, a day"),
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
    assert {"compare", "profile --instructions"} <= set(options)
    assert {name for name, o in options.items() if o.type.name != "SECONDS"} == set()


def test_every_command_that_measures_times_has_a_budget() -> None:
    options = options_of_commands("--budget")
    everyday = {"checkup", "run", "env", "compare", "tune", "versions", "ab", "bisect", "doctor"}
    closer = {"profile", "profile --habits", "latency"}
    assert everyday | closer <= set(options)
    assert {name for name, o in options.items() if o.type.name != "SECONDS"} == set()


def number_options() -> Iterator[tuple[str, click.Option]]:
    """Return every option of every command that takes numbers."""
    text_types = (click.types.StringParamType, click.Path, click.Choice)
    for name, command in cli.commands.items():
        for parameter in command.params:
            if not isinstance(parameter, click.Option) or parameter.is_flag:
                continue
            if not isinstance(parameter.type, text_types) and parameter.type is not NAMES:
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


def numbers_of(value: Any) -> list[float]:
    return list(value) if isinstance(value, list | tuple) else [value]


# What people type, and what they mistype: numbers of any size, units, commas, anything else.
TEXTS = st.one_of(
    st.text(max_size=12),
    st.floats().map(str),
    st.integers().map(str),
    st.lists(st.one_of(st.floats(), st.integers(-5, 5000)), max_size=4).map(
        lambda values: ",".join(map(str, values))
    ),
    st.floats().map(lambda value: f"{value}%"),
    st.floats().map(lambda value: f"{value}s"),
)


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [
        (count(), 1, COUNT.most),
        (numbers(), 1, COUNT.most),
        (numbers(THREADS), 1, THREADS.most),
        (LARGE_COUNT, 1, limits.LARGE_COUNT.most),
        (HERTZ, 0, limits.HERTZ.most),
        (share(), 0, 1),
        (share(below=100.0), 0, 100),
        (seconds(), 0, MAX_SECONDS),
        (seconds(zero=True), 0, MAX_SECONDS),
    ],
)
@settings(deadline=None)
@given(text=TEXTS)
def test_any_text_is_a_value_within_bounds_or_bad_usage(
    kind: click.ParamType[Any], low: float, high: float, text: str
) -> None:
    try:
        numbers = numbers_of(kind.convert(text, None, None))
    except click.BadParameter as refusal:
        assert "\n" not in refusal.message
        return
    assert numbers
    assert len(set(numbers)) == len(numbers)
    assert all(low <= number <= high for number in numbers)


@settings(deadline=None)
@given(text=TEXTS)
def test_any_text_is_names_or_bad_usage(text: str) -> None:
    try:
        names = NAMES.convert(text, None, None)
    except click.BadParameter:
        return
    assert names
    assert all(name and name == name.strip() and "," not in name for name in names)
