"""The page docs/method/c-floor.md, written from results/c_floor.json."""

from collections.abc import Iterator, Sequence

from benchmarks.studies.c_floor_tally import FloorRow, FloorTally, Spread
from mjbench.pages import markdown

HEADING = (
    f"{'model':18} {'path':17} {'C':>9} {'C+timer':>9} {'Python':>9} {'no timer':>9}"
    "   Python / C   no timer / C"
)


def line(row: FloorRow) -> str:
    """Return a row of the table that is printed while it is measured."""
    times = (row.c_ns, row.c_timer_ns, row.python_ns, row.python_off_ns)
    ratios = f"{row.ratio.median:12.3f} {row.off_ratio.median:14.3f}"
    return f"{row.model:18} {row.path:17} {' '.join(f'{ns:9,.0f}' for ns in times)} {ratios}"


def page(tally: FloorTally) -> str:
    """Return the Markdown page of a tally."""
    return "\n".join(_lines(tally)) + "\n"


def _lines(tally: FloorTally) -> Iterator[str]:
    rows, described = tally.rows, tally.machine
    largest = max(rows, key=lambda row: row.ratio.median)
    off = [row.off_ratio.median for row in rows]
    yield "# How close Python comes to C"
    yield ""
    yield (
        f"As imported, MuJoCo in Python takes up to {largest.ratio.median:.2f} times as long as a C"
        f" program (`{largest.model}`, `{largest.path}`), because of [the timer of MuJoCo's Python"
        " package](overhead.md#the-timer-of-mujocos-python-package). Without the timer, it takes"
        f" {min(off):.2f} to {max(off):.2f} times as long."
    )
    yield ""
    yield "Written from `results/c_floor.json` by `python -m benchmarks.c_floor`; do not edit."
    yield ""
    yield "## Nanoseconds of a step"
    yield ""
    yield (
        "The last two columns are the time in Python over that of the C program without a timer,"
        " round by round, with and without the package's timer: the median of"
        f" {tally.launches} launches, and their range."
    )
    yield ""
    columns = ["C", "C with a timer", "Python", "Python without the timer"]
    columns += ["Python / C", "without the timer / C"]
    yield from markdown.table_lines(["model", "path", *columns], map(_cells, rows), columns)
    yield ""
    cores = f"{described.usable_cores} core{'s' * (described.usable_cores != 1)}"
    kind = "a virtual machine with " if described.hypervisor else ""
    yield (
        f"MuJoCo {described.versions['mujoco']} on {kind}{cores} ({described.cpu}), with a load"
        f" average of {described.load_1min:g} at the beginning. What reading a clock costs differs"
        " from machine to machine: `make c-floor` measures yours."
    )
    yield from _HOW


def _cells(row: FloorRow) -> Sequence[str]:
    times = (row.c_ns, row.c_timer_ns, row.python_ns, row.python_off_ns)
    ratios = map(_ratio, (row.ratio, row.off_ratio))
    return [row.model, f"`{row.path}`", *(f"{ns:,.0f}" for ns in times), *ratios]


def _ratio(ratio: Spread) -> str:
    return f"{ratio.median:.3f} ({ratio.low:.3f} to {ratio.high:.3f})"


_HOW = """
## How it is measured

- The C program is `benchmarks/c_floor.c`, compiled with `-O2` against the headers and the library
  of the Python package. It is a process of its own, without Python. It reads the compiled model,
  start states and controls from files, and times its blocks itself with `clock_gettime`.
- The library has no timer (`mjcb_time` is NULL), so a C program pays for one only if it installs
  one. *C with a timer* installs a function like the Python package's: seconds since a start, from
  `CLOCK_MONOTONIC`, which `std::chrono::steady_clock` reads on Linux.
- *Python* is as `import mujoco` leaves it. *Without the timer* is inside
  `mjbench.engine_clock(False)`.
- Path and C program must end in the same states, to the last bit, before and after they are timed.
  Otherwise there is an error and no figure.
- All four take turns on one core. Each two rounds have one random order and its opposite.
- `mj_step(nstep=50)` and `Batch.rollout` return final states, and so does the C program beside
  them. `rollout` returns the state and the sensor data of every step, which the C program beside it
  stores, too.
- Each launch has new processes. Where data lie in memory moves a ratio by some percent from process
  to process. A Batch steps a copy of the model in MjData of its own, which may lie in a faster
  place: figures below 1 are possible.\
""".splitlines()
