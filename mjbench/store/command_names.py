"""Earlier names of commands, which run files, documents and scripts keep, and the present ones."""

from collections.abc import Mapping, Sequence

# Earlier names go on working.
EARLIER: Mapping[str, Sequence[str]] = {
    "diff": ("show", "--against="),  # the old run is the first one
    "explain": ("versions", "--explain"),
    "instructions": ("profile", "--instructions"),
    "merge": ("results", "merge"),
    "overhead": ("profile", "--habits"),
    "placement": ("doctor", "--placement"),
    "report": ("show", "--format", "html"),  # a later --format counts
    "results export": ("show", "--format", "csv"),
    "selfcheck": ("doctor", "--verdicts"),
    "site": ("results", "site"),
}

# Commands of groups, by what their results are named after.
_OF_GROUPS: Mapping[str, Sequence[str]] = {
    "history": ("history", "measure"),
    "history-explain": ("history", "explain"),
    "installs": ("releases", "installs"),
}


def present_name(results_name: str) -> str:
    """Return the command, and its mode, of results that are named after it in files."""
    words = {**EARLIER, **_OF_GROUPS}.get(results_name, (results_name,))
    return " ".join(words).removesuffix("=")
