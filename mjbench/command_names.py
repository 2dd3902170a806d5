"""Which commands `mjbench --help` lists, in groups, and which command words of the user mean.

A name of two words is a mode: `versions --explain` is a command of its own, with its own options
and its own help. `versions` has the flag only so that its help names it.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple


class Listed(NamedTuple):
    """What `mjbench --help` says of a command.

    Attributes:
      does: what it does, so short that the line fits into a narrow terminal.
      takes: about how long it takes by default: for each model, environment or comparison.
    """

    does: str
    takes: str = ""


LISTED: Mapping[str, Mapping[str, Listed]] = {
    "What to change": {
        "checkup": Listed("rank what to change: mjbench TARGET", "1 min"),
        "run": Listed("run a program, and show its slow lines", "40 s"),
        "env": Listed("time the parts of an environment's step", "24 s"),
        "compare": Listed("race ways of stepping, and thread counts", "23 s"),
        "tune": Listed("search for faster settings of a model", "5 min"),
        "lint": Listed("find slow or wrong lines of scripts"),
    },
    "What became slower": {
        "versions": Listed("compare releases of MuJoCo or packages", "1 min"),
        "ab": Listed("compare models, commits or functions", "1 min"),
        "bisect": Listed("find the commit or release that did it", "minutes"),
    },
    "A closer look": {
        "profile": Listed("time the stages of a step", "10 s"),
        "latency": Listed("time ticks, and count missed deadlines", "15 s"),
        "doctor": Listed("check if timings here can be trusted", "18 s"),
    },
    "Results and what there is": {
        "show": Listed("print, export and compare run files"),
        "models": Listed("list the shipped models"),
        "paths": Listed("list the ways of stepping"),
        "releases": Listed("list, install and remove releases"),
        "sweep": Listed("run a matrix of commands with Ray"),
    },
}
# Commands that stand behind an option of another.
MODES = ("profile --habits", "profile --instructions", "versions --explain")
NAMES = (*(name for listed in LISTED.values() for name in listed), *MODES)
# The modules of commands that are not in the one of their first word.
_MODULES = {"models": "available", "paths": "available"}

# Modes, and commands of groups, by what their results are named after.
_OF_RESULTS: Mapping[str, str] = {
    "explain": "versions --explain",
    "installs": "releases installs",
    "instructions": "profile --instructions",
    "overhead": "profile --habits",
}


def module_of(name: str) -> str:
    """Return the module of `mjbench.cli` that has a command."""
    return _MODULES.get(name, name.split()[0])


def with_mode(words: Sequence[str], names: Collection[str]) -> list[str]:
    """Return the words of a command line with a mode as one word."""
    name, *rest = words
    options = rest[: rest.index("--")] if "--" in rest else rest
    for option in options:
        if f"{name} {option}" in names:
            rest.remove(option)
            return [f"{name} {option}", *rest]
    return [name, *rest]


def command_of(results_name: str) -> str:
    """Return the command, and its mode, of results that are named after it in files."""
    return _OF_RESULTS.get(results_name, results_name)
