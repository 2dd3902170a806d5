"""Tables of the committed runs at several widths: what is printed reads back as the numbers.

A page of a terminal is read by the gaps between columns, as a person does.
"""

import functools
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import pytest
from commands import ROOT, mjbench
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from verdict_records import SLOWER

from mjbench.measuring.ratio import Ratio
from mjbench.pages import terminal
from mjbench.paired.bisect import BisectComparison, BisectRecord, VersionRow
from mjbench.paired.metrics import Metric
from mjbench.paired.records import PackageVersions
from mjbench.report import bisect, kinds, verdicts
from mjbench.report.content import DataTable
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import runs

RUNS = ROOT / "results/runs"
WIDTHS = (60, 80, 100, 200)
# A number as tables write it, with what may stand around it.
NUMBER = re.compile(r"[-+×]?[\d,]+(\.\d+)?(–[\d,.]+)?( ±[\d.]+)?( %)?")

Row = Mapping[str, str]

# What no committed run has: a search, packages, and memory that grows.
LONG = VersionRow(1_234, "7" * 40, "Copy states whose subject is longer than a terminal " * 3)
SEARCH = BisectRecord(
    target="bench.py::step",
    old="v1",
    new="HEAD",
    versions=2_000,
    status=Status.OK,
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
    replace(SLOWER, metric=Metric.MEMORY, ratio=Ratio(12.3, 11.1, 13.3)).row(),
]


def tables(text: str, first: str) -> Iterator[list[Row]]:
    """Yield the tables whose heading begins with a title, each row by its headings."""
    lines = text.splitlines()
    for i, line in enumerate(lines):
        if line.split()[:1] != [first]:
            continue
        end = next((n for n in range(i, len(lines)) if is_below(lines[n])), len(lines))
        begin = i
        while begin and lines[begin - 1].startswith("   ") and len(lines[begin - 1]) == len(line):
            begin -= 1  # a heading of several lines ends here
        yield rows([each.ljust(len(line)) for each in lines[begin:end]], i - begin + 1)


def is_below(line: str) -> bool:
    return not line or re.match(r"[A-Z\d]\S* [a-z]", line) is not None


def rows(lines: list[str], nheading: int) -> list[Row]:
    """Return the rows of a table; its columns are apart by two spaces or more in all lines."""
    width = max(map(len, lines))
    lines = [line.ljust(width) for line in lines]
    blank = [all(line[i] == " " for line in lines) for i in range(width)]
    starts = [
        i for i in range(width) if not blank[i] and (i == 0 or (blank[i - 1] and blank[i - 2]))
    ]
    cells = [
        [line[a:b].strip() for a, b in zip(starts, [*starts[1:], width], strict=True)]
        for line in lines
    ]
    titles = [" ".join(filter(None, parts)) for parts in zip(*cells[:nheading], strict=True)]
    read: list[list[str]] = []
    for line in cells[nheading:]:
        if any(NUMBER.fullmatch(cell) for cell in line):
            read.append(line)
        else:  # the rest of names that wrap
            read[-1] = [f"{a} {b}".strip() for a, b in zip(read[-1], line, strict=True)]
    return [dict(zip(titles, row, strict=True)) for row in read]


def shown(name: str, width: int) -> str:
    """Return what is printed of a committed run at a width."""
    done = mjbench("show", str(RUNS / f"{name}.jsonl"), env={"COLUMNS": str(width)})
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def results_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """Return what reads the results of a committed run from its JSON document, once."""

    @functools.cache
    def read(name: str) -> Any:
        file = tmp_path_factory.mktemp("documents") / "out.json"
        done = mjbench("show", str(RUNS / f"{name}.jsonl"), "--json", str(file))
        assert done.returncode == 0, done.stderr
        return json.loads(file.read_text())["results"]

    return read


@pytest.mark.parametrize("width", WIDTHS)
def test_a_comparison_reads_back_as_its_document(
    width: int, results_of: Callable[[str], Any]
) -> None:
    name = "reference-mujoco-4.0.0"
    text, results = shown(name, width), results_of(name)
    printed = [row for table in tables(text, "path") for row in table]
    assert len(printed) == len(results) == 140
    for row, result in zip(printed, results, strict=True):
        options = [f"{name}={value}" for name, value in result["options"].items()]
        assert row["path"] == " ".join([result["path"], *options])
        speedup = result["speedup"]
        assert row["ns/step"] == f"{result['step_ns']:,.0f}"
        assert row["speed-up"] == f"{speedup['estimate']:.2f}"
        is_measure = row["path"] == "python_loop"  # of all others
        ends = "" if is_measure else f"{speedup['low']:.2f}–{speedup['high']:.2f}"
        assert row["95 %"] == ends


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
