"""Causes of change points, which no measurement shows: a table written by hand.

benchmarks/causes.toml names items of MuJoCo's changelog.
"""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from mjbench.errors import InputError, one_line
from mjbench.releases.history import ChangePoint


@dataclass(frozen=True)
class Cause:
    """An item of MuJoCo's changelog that explains change points.

    Attributes:
      release: in which it came.
      where: regular expression over `benchmark (parameters)` of the change points it explains.
      commit: by which the changelog names the item; empty where it names none.
      text: what changed, in our words.
    """

    release: str
    where: str
    commit: str
    text: str


def load(file: Path) -> list[Cause]:
    """Read the table of causes.

    Raises:
      InputError: it cannot be read, or an entry lacks something.
    """
    try:
        entries = tomllib.loads(file.read_text(encoding="utf-8")).get("cause", [])
        causes = msgspec.convert(entries, list[Cause])
        for cause in causes:
            re.compile(cause.where)
        return causes
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}") from error
    except (ValueError, re.error, RecursionError) as error:
        raise InputError(f"cannot read {file}: {one_line(error)}") from error


def explaining(change_point: ChangePoint, causes: Sequence[Cause]) -> list[Cause]:
    """Return the causes that explain a change point."""
    where = f"{change_point.series.benchmark} ({change_point.series.label})"
    return [
        cause
        for cause in causes
        if cause.release == change_point.release and re.search(cause.where, where)
    ]
