"""What compiling took in the environments of `versions` and `ab`, beside steady runs."""

from collections.abc import Sequence

from mjbench import formats
from mjbench.formats import duration
from mjbench.interval import Interval
from mjbench.paired.records import CompilationFigures, VerdictRow
from mjbench.results.content import Column, DataTable, filled


def tables(rows: Sequence[VerdictRow]) -> list[DataTable]:
    """Return one table of all comparisons whose runs are compiled first; none without any."""
    sides = [
        (row.model, label, figures)
        for row in rows
        if (both := row.compiling) is not None
        for label, figures in ((row.old, both.old), (row.new, both.new))
    ]
    table = DataTable.of(
        "Compiling",
        sides,
        (Column("model", leaves=2), lambda side: side[0]),
        (Column("environment", wraps=True), lambda side: side[1]),
        (Column("trace"), lambda side: _time(side[2].trace_s, side[2].processes)),
        (Column("compile"), lambda side: _compile_time(side[2])),
        (Column("first run"), lambda side: _time(side[2].first_run_s, side[2].processes)),
        (Column("steady run"), lambda side: _time(side[2].steady_run_s, side[2].processes)),
        (Column("programs", formats.count, leaves=1), lambda side: side[2].programs),
    )
    return filled(table)


def _compile_time(figures: CompilationFigures) -> str:
    """Return the time without a cache; an earlier comparison of the run may have filled that."""
    return _time(figures.compile_s, figures.compiling_processes) or "from the cache"


def _time(seconds: Interval | None, processes: int) -> str:
    """Return a median with its interval, or of how many processes it is."""
    if seconds is None:
        return ""
    interval = formats.in_brackets(seconds, lambda end: duration(1e9 * end))
    count = "one process" if processes == 1 else f"{processes} processes"
    return f"{duration(1e9 * seconds.estimate)}{interval or f' ({count})'}"
