"""Which commands `mjbench --help` lists, in groups, and which command words of the user mean.

A name of two words is a mode: `doctor --verdicts` is a command of its own, with its own options and
its own help. `doctor` has the flag only so that its help names it.
"""

from collections.abc import Collection, Mapping, Sequence

# What `mjbench --help` says of each command, in its order; lines fit into a narrow terminal.
LISTED: Mapping[str, Mapping[str, str]] = {
    "To begin with": {
        "checkup": "what can I do? the same as `mjbench TARGET`",
    },
    "Every day": {
        "run": "my program: where time goes, what to change",
        "env": "an environment: where the time of a step goes",
        "compare": "the fastest way to step; threads with --scaling",
        "tune": "faster settings of a model; what they change",
        "versions": "is a release slower? why: --explain",
        "ab": "which of two models or git commits is slower?",
        "bisect": "which commit or MuJoCo release made it slower?",
        "lint": "what is slow or wrong in a script",
        "doctor": "can I trust timings here? error rate: --verdicts",
        "show": "stored results again; as a page: --html",
    },
    "A closer look": {
        "profile": "the stages of a step; habits of loops: --habits",
        "latency": "the slowest steps, and which miss a deadline",
        "models": "list the shipped models",
        "paths": "list the ways of stepping",
    },
    "Many runs": {
        "history": "in which release speed changed, and why",
        "releases": "list, install and remove releases",
        "sweep": "a matrix of commands on a Ray cluster",
    },
}

# What became of commands that no longer exist.
REMOVED: Mapping[str, str] = {
    "falls": "`falls` is an example of mjbench's repository now: python docs/examples/falls.py"
}

# Earlier names go on working.
EARLIER: Mapping[str, Sequence[str]] = {
    "diff": ("show", "--against="),  # the old run is the first one
    "explain": ("versions", "--explain"),
    "instructions": ("profile", "--instructions"),
    "overhead": ("profile", "--habits"),
    "report": ("show", "--format", "html"),  # a later --format counts
    "results export": ("show", "--format", "csv"),
    "selfcheck": ("doctor", "--verdicts"),
}
# Commands of groups, by what their results are named after.
_OF_GROUPS: Mapping[str, Sequence[str]] = {
    "history": ("history", "measure"),
    "history-explain": ("history", "explain"),
    "installs": ("releases", "installs"),
}


def with_mode(words: Sequence[str], names: Collection[str]) -> list[str]:
    """Return the words of a command line with the command's present name, a mode as one word."""
    nword = 2 if " ".join(words[:2]) in EARLIER else 1
    earlier = " ".join(words[:nword])
    name, *rest = [*EARLIER.get(earlier, words[:1]), *words[nword:]]
    options = rest[: rest.index("--")] if "--" in rest else rest
    for option in options:
        if f"{name} {option}" in names:
            rest.remove(option)
            return [f"{name} {option}", *rest]
    return [name, *rest]


def present_name(results_name: str) -> str:
    """Return the command, and its mode, of results that are named after it in files."""
    words = {**EARLIER, **_OF_GROUPS}.get(results_name, (results_name,))
    return " ".join(words).removesuffix("=")
