"""What compiling took in the environments of a comparison, beside steady runs."""

from collections.abc import Callable, Iterable, Iterator, Sequence

from mjbench.measuring.stats import Estimate
from mjbench.paired.compilation_figures import CompilationFigures
from mjbench.paired.records import VerdictRow
from mjbench.report import formats
from mjbench.report.content import Cell, Column, DataTable

# A comparison, the environment of one side, and what compiling took there.
_Side = tuple[VerdictRow, str, CompilationFigures]


def tables(rows: Sequence[VerdictRow]) -> list[DataTable]:
    """Return one table of all comparisons whose runs are compiled first; none without any."""
    sides = [*_sides(rows)]
    if not sides:
        return []
    return [
        DataTable.of(
            "Compiling",
            sides,
            (Column("model"), lambda side: side[0].model),
            (Column("environment", wraps=True), lambda side: side[1]),
            *_estimate("trace", "s", 1.0, lambda figures: figures.trace_s),
            *_estimate("compile", "s", 1.0, lambda figures: figures.compile_s),
            *_estimate("cached", "s", 1.0, lambda figures: figures.cached_compile_s, leaves=1),
            *_estimate("first run", "ms", 1e3, lambda figures: figures.first_run_s),
            *_estimate("steady", "ms", 1e3, lambda figures: figures.steady_run_s),
            (Column("programs", formats.count, leaves=3), lambda side: side[2].programs),
        )
    ]


def notes(row: VerdictRow) -> list[str]:
    """Return how many processes the figures of a comparison are of."""
    both = row.compiling
    if not both:
        return []
    traced = _processes(figures.processes for figures in both)
    compiled = _processes(figures.compiling_processes for figures in both)
    if compiled == traced:
        return [f"tracing, compiling and the first run are of {traced} a side"]
    return [
        f"tracing and the first run are of {traced} a side, compiling of {compiled}; the others"
        " found the programs in the compiler's cache"
    ]


def _processes(counts: Iterable[int]) -> str:
    """Return a number of processes; two where the sides differ."""
    fewest, *others = sorted(set(counts))
    if others:
        return f"{fewest:,} or {others[-1]:,} processes"
    return "one process" if fewest == 1 else f"{fewest:,} processes"


def _sides(rows: Sequence[VerdictRow]) -> Iterator[_Side]:
    for row in rows:
        for label, figures in zip((row.old, row.new), row.compiling, strict=False):
            yield row, label, figures


def _estimate(
    title: str,
    unit: str,
    factor: float,
    estimate: Callable[[CompilationFigures], Estimate | None],
    leaves: int = 0,
) -> list[tuple[Column, Callable[[_Side], Cell]]]:
    """Return the columns of a median and of its interval, in a unit of `1 / factor` seconds."""

    def scaled(side: _Side) -> Estimate | None:
        seconds = estimate(side[2])
        if seconds is None:
            return None
        low, high = (None if end is None else factor * end for end in (seconds.low, seconds.high))
        return Estimate(factor * seconds.median, low, high)

    def median(side: _Side) -> Cell:
        value = scaled(side)
        return None if value is None else value.median

    form = formats.digits(3)
    return [
        (Column(f"{title} {unit}", form, leaves=leaves), median),
        (Column(f"95 % of {title}", formats.ends_in(form), leaves=2), scaled),
    ]
