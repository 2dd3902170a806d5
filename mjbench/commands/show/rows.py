"""A run file as a flat table: one row a result, for pandas, polars or a spreadsheet."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mjbench.commands.show import kinds
from mjbench.errors import wrong_argument
from mjbench.results import runs
from mjbench.results.json_form import json_form
from mjbench.results.runs import Run

# What a cell holds.
Cell = str | float | int | bool | None
# Raw samples and code are left out: they are in the run file.
_LEFT_OUT = {"snippet", "samples", "functions", "histogram"}


def load(file: str | Path) -> list[dict[str, Cell]]:
    """Return the results of a run file, a flat dictionary each.

    Keys are those of the JSON documents (docs/formats.md); those of nested values are joined by
    dots, such as `speedup.estimate`. Every row has all keys of the table.

        pandas.DataFrame(mjbench.load("run.jsonl"))
        polars.DataFrame(mjbench.load("run.jsonl"))

    Raises:
      InputError: it cannot be read.
    """
    if not isinstance(file, str | Path):
        raise wrong_argument("file", file, "a path")
    return of_run(runs.load(Path(file), kinds.RECORD_TYPES))


def of_run(run: Run) -> list[dict[str, Cell]]:
    return table_of(result for kind in kinds.kinds_of(run) for result in kind.rows(run))


def table_of(results: Iterable[object]) -> list[dict[str, Cell]]:
    """Return a row for each result; all have the same keys."""
    rows = [dict(_flattened(json_form(result))) for result in results]
    keys = dict.fromkeys(key for row in rows for key in row)
    return [{key: row.get(key) for key in keys} for row in rows]


def _flattened(value: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Cell]]:
    """Yield the cells of nested values; lists of plain values become text, others are left out."""
    for name, item in value.items():
        key = f"{prefix}{name}"
        if name in _LEFT_OUT:
            continue
        match item:
            case dict():
                yield from _flattened(item, f"{key}.")
            case list() | tuple():
                if all(isinstance(each, str | int | float) for each in item):
                    yield key, ", ".join(map(str, item))
                elif name == "sides":
                    for side, target in zip(("old", "new"), item, strict=False):
                        yield from _flattened(target, f"{side}.")
            case _:
                yield key, item
