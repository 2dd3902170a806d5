"""A run file or run set as a flat table: one row a result, for pandas, polars or a spreadsheet."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mjbench.comparison.planning_run import PlanningRow
from mjbench.counts.records import ExplainRecord, InstructionsRecord
from mjbench.environment.records import EnvironmentRecord
from mjbench.instrument import run_set
from mjbench.instrument.json_form import json_form
from mjbench.instrument.machine_identity import identify
from mjbench.instrument.run_set import RunSet
from mjbench.instrument.runs import Run
from mjbench.loop.latency import LatencyRow
from mjbench.loop.overhead import OverheadRow
from mjbench.loop.profile import ProfileRow
from mjbench.paired import selfcheck
from mjbench.paired.placement_spread import SpreadRecord
from mjbench.paired.records import VerdictRecord
from mjbench.paired.selfcheck_records import TrialRecord
from mjbench.program.records import ProgramRow
from mjbench.releases.release_ratios import RatioRecord
from mjbench.report import tuning
from mjbench.report.documents import RECORD_TYPES
from mjbench.report.program import program_rows
from mjbench.report.results import derive_all
from mjbench.tuning.records import TuneRecord
from mjbench.web.records import WebRecord

# What a cell holds.
Cell = str | float | int | bool | None
# Raw samples and code are left out: they are in the run file.
_LEFT_OUT = {"snippet", "samples", "functions", "histogram"}
# What a table has of a path of `mjbench web`.
_WEB_KEYS = (
    *("path", "options", "status", "detail", "is_identical", "difference"),
    *("step_ns", "steps_per_s", "ratio", "heap_bytes", "rss_bytes"),
)


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
    return of_set(run_set.read(Path(file), RECORD_TYPES))


def of_set(stored: RunSet) -> list[dict[str, Cell]]:
    """Return the results of a run file or of a run set that was read; see `load`."""
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
    """Return the results of a run that was read; see `load`."""
    return _with_all_keys(_rows(run))


def _rows(run: Run) -> Iterator[dict[str, Cell]]:
    return (dict(_flattened(json_form(result))) for result in _results(run))


def _with_all_keys(some: Iterable[dict[str, Cell]]) -> list[dict[str, Cell]]:
    rows = list(some)
    keys = dict.fromkeys(key for row in rows for key in row)
    return [{key: row.get(key) for key in keys} for row in rows]


def _results(run: Run) -> Iterator[object]:
    """Yield the results of a run of any command, one a row."""
    for model_results in derive_all(run.records):
        yield from model_results.results
    for verdict in run.of_type(VerdictRecord):
        yield verdict.row()
    if trials := run.of_type(TrialRecord):
        yield from selfcheck.summary(trials)
    yield from run.of_type(SpreadRecord)
    for kind in (OverheadRow, ProfileRow, LatencyRow, PlanningRow, EnvironmentRecord):
        yield from run.of_type(kind)
    for program in run.of_type(ProgramRow):
        yield from program_rows(program)
    for search in run.of_type(TuneRecord):
        yield from tuning.rows(search)
    for web_record in run.of_type(WebRecord):
        yield from _web_rows(web_record)
    yield from run.of_type(RatioRecord)
    yield from run.of_type(ExplainRecord)
    yield from run.of_type(InstructionsRecord)


def _web_rows(record: WebRecord) -> Iterator[Mapping[str, object]]:
    """Yield the paths on a model, a row each."""
    for path in record.path_results:
        figures = {key: getattr(path, key) for key in _WEB_KEYS}
        yield {"model": record.model, "release": record.release, **figures}


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
                if _is_plain(item):
                    yield key, ", ".join(map(str, item))
                elif name == "sides":
                    for side, target in zip(("old", "new"), item, strict=False):
                        yield from _flattened(target, f"{side}.")
            case _:
                yield key, item


def _is_plain(items: Sequence[Any]) -> bool:
    return all(isinstance(item, str | int | float) for item in items)
