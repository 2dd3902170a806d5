"""Options: the texts and values that stand for them, and what each declaration becomes."""

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import mjbench
from mjbench import options
from mjbench.cli import cli
from mjbench.commands.checkup import driver as checkup
from mjbench.commands.checkup.driver import CheckupPlan
from mjbench.commands.checkup.options import CheckupOptions
from mjbench.commands.compare import driver as model_comparison
from mjbench.commands.compare.options import CompareOptions
from mjbench.commands.doctor.options import DoctorOptions
from mjbench.commands.env import driver as env
from mjbench.commands.env.options import EnvironmentOptions
from mjbench.commands.latency import measure as latency
from mjbench.commands.latency.options import LatencyOptions
from mjbench.commands.profile import driver as profile
from mjbench.commands.profile.options import HabitOptions, InstructionOptions, ProfileOptions
from mjbench.commands.run import driver as run
from mjbench.commands.run.options import RunOptions
from mjbench.commands.show.options import ListOptions, ShowOptions
from mjbench.commands.sweep.options import SweepOptions
from mjbench.commands.tune import driver as tune
from mjbench.commands.tune.options import TuneOptions
from mjbench.commands.versions.driver import between_releases
from mjbench.commands.versions.options import ExplainOptions, RevisionOptions, VersionsOptions
from mjbench.counts import instructions
from mjbench.errors import InputError
from mjbench.limits import COUNT, MAX_SECONDS, THREADS, Bounds
from mjbench.options import Kind, Option, options_of
from mjbench.paired import run_sizes
from mjbench.releases import installs
from mjbench.results.runs import to_json
from mjbench.session import Measurement
from mjbench.simulation import models
from mjbench.verification import plan

CARTPOLE = models.resolve("cartpole")
KINDS: dict[str, type[Any]] = {
    "ab": RevisionOptions,
    "bisect": RevisionOptions,
    "checkup": CheckupOptions,
    "compare": CompareOptions,
    "doctor": DoctorOptions,
    "env": EnvironmentOptions,
    "latency": LatencyOptions,
    "models": ListOptions,
    "profile": ProfileOptions,
    "profile --habits": HabitOptions,
    "profile --instructions": InstructionOptions,
    "run": RunOptions,
    "show": ShowOptions,
    "sweep": SweepOptions,
    "tune": TuneOptions,
    "versions": VersionsOptions,
    "versions --explain": ExplainOptions,
}
MEASUREMENTS: dict[str, Callable[[Any], Measurement]] = {
    "checkup": lambda given: checkup.measurement(CARTPOLE, CheckupPlan.of(given)),
    "compare": lambda given: model_comparison.measurement(
        [CARTPOLE], model_comparison.plans_of(given), given.budget
    ),
    "env": lambda given: env.measurement(["Humanoid-v5"], given),
    "latency": lambda given: latency.measurement([CARTPOLE], given),
    "profile": lambda given: profile.measurement([CARTPOLE], given),
    "profile --habits": lambda given: profile.of_habits([CARTPOLE], given),
    "run": lambda given: run.measurement([__file__], given),
    "tune": lambda given: tune.measurement([CARTPOLE], given),
    "versions": lambda given: between_releases(
        installs.parse_available(["installed", "installed"]), [CARTPOLE], given.paths, given.plan
    ),
}
# Another value of an option than its default; of any other option, what 3 stands for.
OTHER = {
    "metric": "load",
    "options": ["pool=kept"],
    "paths": ["rollout"],
    "precision": 0.003,
    "returns": "sensors",
    "allow": "free",
    "only": ["solver"],
    "skip": ["timestep"],
}


def other_value(option: Option) -> Any:
    if option.kind.is_flag:
        return not option.default
    return OTHER.get(option.name) or option.kind.parse("3")


@pytest.mark.parametrize("command", KINDS)
def test_help_has_each_option_with_its_text(command: str) -> None:
    words = command.split(" ")
    text = CliRunner().invoke(cli, [*words, "--help"], terminal_width=96).output
    for option in options_of(KINDS[command]):
        assert option.flags[0].split("/")[0] in text
        assert "".join(option.text.split()) in "".join(text.split()), option.name


@pytest.mark.parametrize("command", ["checkup", "compare", "latency", "profile", "versions"])
def test_a_function_has_each_option_with_its_type_default_and_text(command: str) -> None:
    function = getattr(mjbench, command)
    parameters = inspect.signature(function).parameters
    for option in options_of(KINDS[command]):
        parameter = parameters.get(option.name)
        is_keyword = parameter is not None and parameter.kind == parameter.KEYWORD_ONLY
        assert is_keyword == option.of_functions, option.name
        if parameter is not None and is_keyword:
            assert parameter.default == option.default
            assert parameter.annotation == option.annotation
            text = "".join(f"{option.name}: {option.text}".split())
            assert text in "".join(function.__doc__.split()), option.name


@pytest.mark.parametrize("command", MEASUREMENTS)
def test_the_header_of_a_run_file_tells_each_option_from_another_value(command: str) -> None:
    kind, measurement_of = KINDS[command], MEASUREMENTS[command]
    usual = to_json(measurement_of(kind()).arguments)
    for option in options_of(kind):
        if option.is_stored:
            changed = measurement_of(kind(**{option.name: other_value(option)}))
            assert to_json(changed.arguments) != usual, option.name


@pytest.mark.parametrize("function", mjbench.__all__)
def test_functions_are_documented_and_typed(function: str) -> None:
    described = getattr(mjbench, function)
    assert described.__doc__
    signature = inspect.signature(described)
    if not inspect.isclass(described):
        assert signature.return_annotation is not inspect.Signature.empty
    for name, parameter in signature.parameters.items():
        assert parameter.annotation is not inspect.Parameter.empty, name


def test_a_function_knows_no_option_of_the_command_line_alone() -> None:
    with pytest.raises(
        TypeError, match=r"latency\(\): got an unexpected keyword argument 'resume'"
    ):
        mjbench.latency("cartpole", resume="run.jsonl")


def test_sizes_that_are_chosen_are_those_that_help_names() -> None:
    counted, block_ms = instructions, 1000 * plan.LONG_BLOCK_S
    unset = {each.name: each.unset for each in options_of(RevisionOptions)}
    assert f"1 ms, or {1000 * run_sizes.THREADED_RUN_S:g} ms for each" in unset["nbatch"]
    assert 1000 * run_sizes.RUN_S == 1
    assert f"{counted.NBATCH} to count instructions" in unset["nbatch"]
    assert f"up to {run_sizes.MAX_NSTEP} within" in unset["nstep"]
    assert f"{counted.NSTEP} to count instructions" in unset["nstep"]
    unset = {each.name: each.unset for each in options_of(CompareOptions)}
    assert unset["nbatch"].startswith(f"{plan.NBATCH}; fewer")
    assert unset["nstep"].startswith(f"{plan.NSTEP}; fewer")
    assert f"more than {block_ms:g} ms" in unset["nbatch"]


def test_own_options_come_before_those_of_base_classes() -> None:
    names = [option.name for option in options_of(LatencyOptions)]
    assert names[:6] == ["tick", "deadline_s", "rate_hz", "nstep", "findings", "budget_s"]


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (options.numbers(), "1,2,4", [1, 2, 4]),
        (options.numbers(), "2,2,1", [2, 1]),
        (options.NAMES, "rollout, mjx", ["rollout", "mjx"]),
        (options.SHARE, "1%", 0.01),
        (options.SHARE, "0.5%", 0.005),
        (options.SHARE, "1", 0.01),
        (options.share(below=math.inf), "250", 2.5),
        (options.SECONDS, "60s", 60.0),
        (options.SECONDS, "0.5", 0.5),
        (options.SECONDS, "1ms", 0.001),
        (options.SECONDS, "500us", 0.0005),
        (options.SECONDS, "2min", 120.0),
        (options.LARGE_COUNT, "1e9", 10**9),
        (options.HERTZ, "500Hz", 500.0),
        (options.SECONDS_OR_ZERO, "0", 0.0),
    ],
)
def test_texts_stand_for_values(kind: Kind, text: str, value: Any) -> None:
    assert kind.parse(text) == value


@pytest.mark.parametrize(
    ("kind", "given", "value"),
    [
        (options.SECONDS, 0.5, 0.5),
        (options.SECONDS_OR_ZERO, 0, 0.0),
        (options.SHARE, 0.01, 0.01),
        (options.HERTZ, 500, 500.0),
        (options.COUNT, np.int64(3), 3),
        (options.SEED, 0, 0),
        (options.numbers(), 4, [4]),
        (options.numbers(), (1, 2, 1), [1, 2]),
        (options.NAMES, "rollout, mjx", ["rollout", "mjx"]),
        (options.NAMES, ["a", "b,a"], ["a", "b"]),
        (options.LARGE_COUNT, 1e9, 10**9),
        (options.choice("time", "load"), "load", "load"),
        (options.SETTINGS, {"pool": ["new", "kept"], "chunk": 4}, ["pool=new,kept", "chunk=4"]),
    ],
)
def test_a_program_may_give(kind: Kind, given: Any, value: Any) -> None:
    assert kind.check("size", given) == value


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        *((options.SECONDS, value) for value in (0, -1, math.nan, math.inf, "soon", None)),
        *((options.SHARE, value) for value in (0, 1, 5)),
        *((options.COUNT, value) for value in (0, 1.5, True, 2**31)),
        *((options.SEED, value) for value in (-1, 2**63)),
        *((options.numbers(), value) for value in ([], [0], "12")),
        *((options.NAMES, value) for value in ([], ",", [3])),
        (options.count(Bounds(1, 5)), 6),
        *((options.LARGE_COUNT, value) for value in (1e16, math.inf)),
        (options.choice("time", "load"), "tea"),
        (options.HERTZ, 1e7),
        (options.SETTINGS, "pool=new"),
    ],
)
def test_other_values_are_refused_in_a_line_that_names_the_option(kind: Kind, value: Any) -> None:
    with pytest.raises(InputError, match=r"^size ") as error:
        kind.check("size", value)
    assert "\n" not in str(error.value)


def test_none_stands_for_a_default_that_is_none() -> None:
    by_name = {option.name: option for option in options_of(LatencyOptions)}
    assert by_name["nstep"].checked(None) is None
    with pytest.raises(InputError, match="tick must be a whole number"):
        by_name["tick"].checked(None)


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
        (options.COUNT, 1, COUNT.most),
        (options.numbers(), 1, COUNT.most),
        (options.THREADS, 1, THREADS.most),
        (options.LARGE_COUNT, 1, 10**15),
        (options.HERTZ, 0, 1_000_000),
        (options.SHARE, 0, 1),
        (options.share(below=100.0), 0, 100),
        (options.SECONDS, 0, MAX_SECONDS),
        (options.SECONDS_OR_ZERO, 0, MAX_SECONDS),
    ],
)
@settings(deadline=None)
@given(text=TEXTS)
def test_any_text_is_a_value_within_bounds_or_refused(
    kind: Kind, low: float, high: float, text: str
) -> None:
    try:
        value = kind.parse(text)
    except ValueError:
        return
    numbers = value if isinstance(value, list) else [value]
    assert numbers
    assert len(set(numbers)) == len(numbers)
    assert all(low <= number <= high for number in numbers)


@settings(deadline=None)
@given(text=TEXTS)
def test_any_text_is_names_or_refused(text: str) -> None:
    try:
        names = options.NAMES.parse(text)
    except ValueError:
        return
    assert names
    assert all(name and name == name.strip() and "," not in name for name in names)


@pytest.mark.parametrize(
    ("given", "precision"),
    [
        ({}, 0.005),
        ({"min_effect": 0.004}, 0.002),
        ({"min_effect": 0.1}, 0.005),
        ({"precision": 0.001}, 0.001),
    ],
)
def test_a_precision_follows_from_the_smallest_effect(
    given: dict[str, float], precision: float
) -> None:
    assert VersionsOptions(**given).plan.precision == precision


def test_a_precision_that_would_change_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"--precision 2% changes nothing above 0.5%, half of"):
        _ = VersionsOptions(precision=0.02).plan
