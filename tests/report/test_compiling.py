"""What compiling took, as people read it."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
from verdict_records import SAME

from mjbench.measuring.calls import Compilation
from mjbench.pages import terminal
from mjbench.paired.compilation_figures import CompilationFigures
from mjbench.paired.records import VerdictRow
from mjbench.report import compiling, verdicts

FRESH = Compilation(trace_s=2.0, compile_s=8.0, first_run_s=0.1, programs=31)
CACHED = replace(FRESH, compile_s=0.4, is_cached=True)


def row_of(baseline: Sequence[Compilation], candidate: Sequence[Compilation]) -> VerdictRow:
    figures = [CompilationFigures.of(each, [0.01] * 8) for each in (baseline, candidate)]
    return replace(SAME, compiling=figures).row()


def test_each_side_has_its_times_beside_steady_runs() -> None:
    row = row_of([FRESH, *[CACHED] * 8], [FRESH, *[CACHED] * 8])
    text = terminal.text_of([verdicts.section([row], 0.99)])
    (table,) = compiling.tables([row])
    titles = [column.title for column in table.columns]
    assert [dict(zip(titles, cells, strict=True)) for cells in table.texts] == [
        {
            "model": "m",
            "environment": environment,
            "trace s": "2",
            "95 % of trace": "2–2",
            "compile s": "8",
            "95 % of compile": "",
            "cached s": "0.4",
            "95 % of cached": "0.4–0.4",
            "first run ms": "100",
            "95 % of first run": "100–100",
            "steady ms": "10",
            "95 % of steady": "10–10",
            "programs": "31",
        }
        for environment in ("1.0.0", "2.0.0")
    ]
    assert "first run ms" in text


@pytest.mark.parametrize(
    ("baseline", "candidate", "line"),
    [
        ([FRESH], [FRESH], "tracing, compiling and the first run are of one process a side"),
        ([FRESH] * 9, [FRESH] * 9, "compiling and the first run are of 9 processes a side"),
        ([FRESH, CACHED], [FRESH, CACHED], "of 2 processes a side, compiling of one process;"),
        ([CACHED, CACHED], [FRESH, CACHED], "compiling of 0 or 1 processes;"),
    ],
)
def test_a_line_says_how_many_processes_the_times_are_of(
    baseline: Sequence[Compilation], candidate: Sequence[Compilation], line: str
) -> None:
    (note,) = compiling.notes(row_of(baseline, candidate))
    assert line in note


def test_steps_in_c_have_no_such_table() -> None:
    assert compiling.tables([SAME.row()]) == []
    assert compiling.notes(SAME.row()) == []
