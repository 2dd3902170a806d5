"""What compiling took, as people read it."""

from collections.abc import Sequence
from dataclasses import replace

from verdict_records import SAME

from mjbench.commands.versions import compile_times
from mjbench.commands.versions import show as verdicts
from mjbench.measuring.calls import Compilation
from mjbench.paired.records import CompilationFigures, Pair, VerdictRow
from mjbench.results import terminal

FRESH = Compilation(trace_s=2.0, compile_s=8.0, first_run_s=0.1, programs=31)
CACHED = replace(FRESH, compile_s=0.4, is_cached=True)


def row_of(baseline: Sequence[Compilation], candidate: Sequence[Compilation]) -> VerdictRow:
    figures = (CompilationFigures.of(each, [0.01] * 8) for each in (baseline, candidate))
    return replace(SAME, compiling=Pair(*figures)).row()


def test_each_side_has_its_times_beside_steady_runs() -> None:
    row = row_of([FRESH, *[CACHED] * 8], [FRESH, *[CACHED] * 8])
    (table,) = compile_times.tables([row])
    titles = [column.title for column in table.columns]
    assert [dict(zip(titles, cells, strict=True)) for cells in table.texts] == [
        {
            "model": "m",
            "environment": environment,
            "trace": "2 s (2 s–2 s)",
            "compile": "8 s (one process)",
            "first run": "100 ms (100 ms–100 ms)",
            "steady run": "10 ms (10 ms–10 ms)",
            "programs": "31",
        }
        for environment in ("1.0.0", "2.0.0")
    ]
    assert "first run" in terminal.text_of([verdicts.section([row], 0.99)])


def test_a_median_without_an_interval_has_its_number_of_processes() -> None:
    (table,) = compile_times.tables([row_of([FRESH, FRESH], [CACHED])])
    assert [cells[2:4] for cells in table.texts] == [
        ["2 s (2 processes)", "8 s (2 processes)"],
        ["2 s (one process)", "from the cache"],
    ]


def test_steps_in_c_have_no_such_table() -> None:
    assert compile_times.tables([SAME.row()]) == []
