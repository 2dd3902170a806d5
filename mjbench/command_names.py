"""Which commands `mjbench --help` lists, in groups, and which command words of the user mean.

A name of two words is a mode: `versions --explain` is a command of its own, with its own options
and its own help. `versions` has the flag only so that its help names it.
"""

from collections.abc import Collection, Mapping, Sequence

# What `mjbench --help` says of each command, in its order; lines fit into a narrow terminal.
LISTED: Mapping[str, Mapping[str, str]] = {
    "Every day": {
        "checkup": "what can I do? the same as `mjbench TARGET`",
        "run": "my program: where time goes, what to change",
        "env": "an environment: where the time of a step goes",
        "compare": "the fastest way to step; threads with --scaling",
        "tune": "faster settings of a model; what they change",
        "versions": "is a release slower? why: --explain",
        "ab": "which of two models or git commits is slower?",
        "bisect": "which commit or MuJoCo release made it slower?",
        "lint": "what is slow or wrong in a script",
        "doctor": "can I trust timings here?",
        "show": "stored results again; as a page: --html",
    },
    "A closer look": {
        "profile": "the stages of a step; habits of loops: --habits",
        "latency": "the slowest ticks, and which miss a deadline",
        "models": "list the shipped models",
        "paths": "list the ways of stepping",
        "releases": "list, install and remove releases",
        "sweep": "a matrix of commands on a Ray cluster",
    },
}

# Modes, and commands of groups, by what their results are named after.
_OF_RESULTS: Mapping[str, str] = {
    "diff": "show --against",
    "explain": "versions --explain",
    "installs": "releases installs",
    "instructions": "profile --instructions",
    "overhead": "profile --habits",
}


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
