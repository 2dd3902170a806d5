"""What docs/method/c.md has of results/c_floor.json."""

from collections.abc import Iterator, Sequence

from benchmarks.studies.c_floor_tally import FloorRow, FloorTally, Spread
from benchmarks.studies.page_part import PagePart
from mjbench.results import markdown

PART = PagePart("method/c.md", "c-floor", "benchmarks.studies.c_floor_page")

# Which rows the page shows; its conclusion is about all.
PATH = "mj_step(nstep=50)"
HEADING = (
    f"{'model':18} {'path':17} {'C':>9} {'C+timer':>9} {'Python':>9} {'no timer':>9}"
    "   Python / C   no timer / C"
)


def line(row: FloorRow) -> str:
    """Return a row of the table that is printed while it is measured."""
    times = (row.c_ns, row.c_timer_ns, row.python_ns, row.python_off_ns)
    ratios = f"{row.ratio.median:12.3f} {row.off_ratio.median:14.3f}"
    return f"{row.model:18} {row.path:17} {' '.join(f'{ns:9,.0f}' for ns in times)} {ratios}"


def lines(tally: FloorTally) -> Iterator[str]:
    """Yield the conclusion, then a row for each model and path."""
    rows, described = tally.rows, tally.machine
    largest = max(rows, key=lambda row: row.ratio.median)
    off = [row.off_ratio.median for row in rows]
    yield (
        f"As imported, MuJoCo in Python takes up to {largest.ratio.median:.2f} times as long as a C"
        f" program (`{largest.model}`, `{largest.path}`). Without the timer, it takes"
        f" {min(off):.2f} to {max(off):.2f} times as long."
    )
    yield ""
    cores = f"{described.usable_cores} core{'s' * (described.usable_cores != 1)}"
    kind = "a virtual machine with " if described.hypervisor else ""
    yield (
        f"The table shows `{PATH}`: the time in Python over that of the C program without a timer,"
        f" as the median of {tally.launches} launches and their range. MuJoCo"
        f" {described.versions['mujoco']} ran on {kind}{cores} ({described.cpu}), with a load"
        f" average of {described.load_1min:g} at the beginning."
    )
    yield ""
    columns = ["C, ns/step", "as imported", "without the timer"]
    cells = (_cells(row) for row in rows if row.path == PATH)
    yield from markdown.table_lines(["model", *columns], cells, columns)


def _cells(row: FloorRow) -> Sequence[str]:
    ratios = map(_ratio, (row.ratio, row.off_ratio))
    return [row.model, f"{row.c_ns:,.0f}", *ratios]


def _ratio(ratio: Spread) -> str:
    return f"{ratio.median:.2f} ({ratio.low:.2f}–{ratio.high:.2f})"
