"""A run file or run set as a flat table: one row a result, for pandas, polars or a spreadsheet."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mjbench.report import kinds
from mjbench.store import run_set
from mjbench.store.json_form import json_form
from mjbench.store.machine_identity import identify
from mjbench.store.run_set import RunSet
from mjbench.store.runs import Run

# What a cell holds.
Cell = str | float | int | bool | None
# Raw samples and code are left out: they are in the run file.
_LEFT_OUT = {"snippet", "samples", "functions", "histogram"}


def load(file: str | Path) -> list[dict[str, Cell]]:
    """Return the results of a run file or of a run set, a flat dictionary each.

    Keys are those of the JSON documents (docs/formats.md); those of nested values are joined by
    dots, such as `speedup.estimate`. Every row has all keys of the table. Rows of a set begin with
    `machine`, the name of the machine among those of the set, `cell`, what of a sweep it is, and
    `began`, when the run began.

        pandas.DataFrame(mjbench.load("run.jsonl"))
        polars.DataFrame(mjbench.load("run.jsonl"))

    Args:
      file: a run file, or a run set.

    Raises:
      InputError: it cannot be read.
    """
    return of_set(run_set.read(Path(file), kinds.RECORD_TYPES))


def of_set(stored: RunSet) -> list[dict[str, Cell]]:
    sections = run_set.distinct(stored.sections)
    if stored.is_run_file:
        return of_run(sections[0].run)
    machines = identify([section.run.header.machine for section in sections])
    return _with_all_keys(
        {
            "machine": machine.name,
            "cell": section.cell,
            "began": section.run.header.began,
            **row,
        }
        for section, machine in zip(sections, machines, strict=True)
        for row in _rows(section.run)
    )


def of_run(run: Run) -> list[dict[str, Cell]]:
    return _with_all_keys(_rows(run))


def _rows(run: Run) -> Iterator[dict[str, Cell]]:
    for kind in kinds.kinds_of(run):
        for result in kind.rows(run):
            yield dict(_flattened(json_form(result)))


def _with_all_keys(some: Iterable[dict[str, Cell]]) -> list[dict[str, Cell]]:
    rows = list(some)
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
