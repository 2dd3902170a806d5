"""Causes of change points that no measurement names: a table written by hand.

causes.toml names items of MuJoCo's changelog, and causes that other measurements showed.
"""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from mjbench.errors import InputError, one_line

FILE = Path(__file__).with_name("causes.toml")


@dataclass(frozen=True)
class KnownCause:
    """Why models or operations changed in a release.

    Attributes:
      series: regular expression that matches the whole names of the models and operations.
      commit: by which the changelog names the item; empty where it names none.
    """

    release: str
    series: str
    commit: str
    text: str


def load(file: Path) -> list[KnownCause]:
    """Read the table of causes; InputError where an entry lacks something."""
    try:
        entries = tomllib.loads(file.read_text(encoding="utf-8")).get("cause", [])
        causes = msgspec.convert(entries, list[KnownCause])
        for cause in causes:
            re.compile(cause.series)
        return causes
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}") from error
    except (ValueError, re.error, RecursionError) as error:
        raise InputError(f"cannot read {file}: {one_line(error)}") from error


def explaining(release: str, series: str, causes: Sequence[KnownCause]) -> list[KnownCause]:
    return [
        cause for cause in causes if cause.release == release and re.fullmatch(cause.series, series)
    ]
