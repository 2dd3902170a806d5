"""Tables of the committed runs at several widths: no number is cut, no table is too wide."""

import functools
import io
import re
from dataclasses import replace

import pytest
from commands import ROOT
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from verdict_records import SLOWER

from mjbench.commands.show import kinds
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.versions import bisect_show as bisect
from mjbench.commands.versions import show as verdicts
from mjbench.commands.versions.bisect import BisectComparison, BisectRecord, VersionRow
from mjbench.interval import Interval
from mjbench.paired.metrics import Metric
from mjbench.paired.records import PackageVersions
from mjbench.results import runs, terminal
from mjbench.results.content import DataTable
from mjbench.status import Status

RUNS = ROOT / "results/runs"
WIDTHS = (60, 100)

# What no committed run has: a search, packages, and memory that grows.
LONG = VersionRow(1_234, "7" * 40, "Copy states whose subject is longer than a terminal " * 3)
SEARCH = BisectRecord(
    target="bench.py::step", old="v1", new="HEAD", versions=2_000, status=Status.OK
)
COMPARISONS = [
    BisectComparison(12, LONG, SLOWER),
    BisectComparison(12, LONG, None, "cannot build it " * 9),
]
OTHER_VERDICTS = [
    replace(
        SLOWER,
        old="jax==0.7.0",
        new="jax==0.7.1",
        packages=[PackageVersions("jax", "0.7.0", "0.7.1")],
    ).row(),
    replace(SLOWER, metric=Metric.MEMORY, ratio=Interval(12.3, 11.1, 13.3)).row(),
]


@functools.cache
def committed_tables() -> list[tuple[str, DataTable]]:
    """Return the tables of all committed runs, each with its file."""
    tables = []
    counts = (ROOT / "results/history").glob("reference-counts*.jsonl")
    for file in [*sorted(RUNS.glob("*.jsonl")), *counts]:
        run = runs.load(file, RECORD_TYPES)
        sections = kinds.kind_of(run).sections(run)
        tables += [(file.name, table) for section in sections for table in section.tables]
    tables += [("bisect", table) for table in bisect.sections([*COMPARISONS, SEARCH])[0].tables]
    tables += [("packages", table) for table in verdicts.section(OTHER_VERDICTS, 0.99).tables]
    return [(name, table) for name, table in tables if table.rows]


@pytest.mark.parametrize("width", WIDTHS)
def test_no_number_is_cut_and_no_table_is_wider_than_the_terminal(width: int) -> None:
    assert len(committed_tables()) > 50
    for name, table in committed_tables():
        printed, *left_out = terminal.table_parts(table, width)
        assert isinstance(printed, Table)
        out = Console(file=io.StringIO(), width=1000)
        out.print(printed)
        text = out.file.getvalue()  # type: ignore[attr-defined]
        assert max(map(cell_len, text.splitlines())) <= width, name
        headings = [column.header for column in printed.columns]
        filled = table.filled_columns()
        gone = {column.title for column in filled.columns if column.title not in headings} - {""}
        named = str(left_out[0]).partition(": ")[2].split(", ") if left_out else []
        assert set(named) == gone, name
        words = {word.strip() for word in re.split(r"\n| {2,}", text)}
        for i, column in enumerate(filled.columns):
            if column.is_right_aligned and column.title in headings:
                cut = [row[i] for row in filled.texts if row[i] and row[i].strip() not in words]
                assert cut == [], (name, column.title)
