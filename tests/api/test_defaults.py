"""The functions take what the commands take, with the same defaults."""

import inspect
from pathlib import Path
from typing import Any

import pytest

import mjbench
from mjbench.api.measured import Measured
from mjbench.cli import cli
from mjbench.cli.shared import RESULTS_FOLDER
from mjbench.verification.plan import BUDGET_S

# Parameters of commands by those of functions, where the names differ.
RENAMED = {
    "names": "models",
    "path_names": "paths",
    "option_words": "options",
    "states_file": "states",
    "actions_file": "actions",
    "budget": "budget_s",
    "limit_s": "time_limit_s",
}
# What only commands have: where results go, what is printed, exit codes.
OF_COMMANDS = {
    *("results", "resume", "json_file", "code", "findings", "allow_inconclusive"),
    *("html_file", "markdown_file", "target", "arguments"),
}
# `compare --quick` and `--scaling` stand for other options; `--new` names releases that may also
# be arguments.
# `--family` is for verdicts of several commands, `--function` for environments.
NOT_HERE = {"quick", "scaling", "news", "old", "family", "functions"}
# What only functions have.
OF_FUNCTIONS = {"target", "arguments", "quick", "on_progress", "model", "models", "old", "news"}
# Where the command's default is chosen by what it calls, and its help says so.
CHOSEN_LATER = {"budget_s": BUDGET_S, "paths": "python_loop"}


def options_of(command: str) -> dict[str, Any]:
    """Return the defaults of a command's options, by the names that functions have for them."""
    context = cli.commands[command].make_context(command, ["cartpole"])
    return {
        RENAMED.get(name, name): value if value != () else None
        for name, value in context.params.items()
        if name not in OF_COMMANDS | NOT_HERE | {"names"}
    }


@pytest.mark.parametrize("command", ["checkup", "compare", "versions", "profile", "latency"])
def test_a_function_has_the_options_of_its_command(command: str) -> None:
    parameters = inspect.signature(getattr(mjbench, command)).parameters
    options = options_of(command)
    assert set(parameters) - OF_FUNCTIONS == set(options)
    for name, default in options.items():
        expected = default
        if default is None and parameters[name].default is not None:
            expected = CHOSEN_LATER[name]
        assert parameters[name].default == expected, name


@pytest.mark.parametrize("function", mjbench.__all__)
def test_functions_are_documented_and_typed(function: str) -> None:
    described = getattr(mjbench, function)
    assert described.__doc__
    signature = inspect.signature(described)
    if not inspect.isclass(described):
        assert signature.return_annotation is not inspect.Signature.empty
    for name, parameter in signature.parameters.items():
        assert parameter.annotation is not inspect.Parameter.empty, name


def test_a_result_is_saved_where_commands_store_theirs() -> None:
    default = inspect.signature(Measured.save).parameters["folder"].default
    assert Path(default) == RESULTS_FOLDER
