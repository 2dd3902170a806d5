"""What `pytest --benchmark-only` prints: a table for each group of what is compared.

Times are of one thing, such as a step, and not of a call that does many of them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench import formats
from mjbench.formats import duration, listed
from mjbench.results.content import Column, DataTable

WIDTH = 100
# Names in a closing line, at most; of more it says how many.
MOST_NAMES = 4
CAUTION = (
    "These are times of one process. From one to the next, the same code differs by several"
    " percent. Whether a change of yours is slower: mjbench ab main HEAD bench.py::FUNCTION"
)


@dataclass(frozen=True)
class BenchmarkTime:
    """The time of one benchmark.

    Attributes:
      group: what it is compared within, such as `rollout, by threads: humanoid`.
      variant: which of the group it is, such as `threads=2`.
      per: the thing that `median_ns` is of, such as `step`.
      low_ns: the lower quartile; `high_ns` is the upper one.
      is_comparable: whether the others of the group do the same work.
    """

    group: str
    variant: str
    per: str
    median_ns: float
    low_ns: float
    high_ns: float
    rounds: int
    is_comparable: bool


def groups(times: Sequence[BenchmarkTime]) -> Iterator[tuple[DataTable, str]]:
    """Yield the table of each group, in the order of their first time, and a closing line."""
    for name in dict.fromkeys(time.group for time in times):
        group = sorted((t for t in times if t.group == name), key=lambda t: t.median_ns)
        yield _table(name, group), _closing_line(group)


def _table(name: str, group: Sequence[BenchmarkTime]) -> DataTable:
    fastest = group[0].median_ns
    return DataTable.of(
        name,
        group,
        (Column(""), lambda time: time.variant),
        (Column(f"time of a {group[0].per}", duration), lambda time: time.median_ns),
        (Column("IQR", duration), lambda time: time.high_ns - time.low_ns),
        (Column("rounds", formats.count), lambda time: time.rounds),
        (
            Column("relative", formats.factor),
            lambda time: time.median_ns / fastest if time.is_comparable else None,
        ),
    )


def _closing_line(group: Sequence[BenchmarkTime]) -> str:
    """Return what a group comes to: the fastest, or those that quartiles do not tell apart."""
    fastest = group[0]
    if not fastest.is_comparable:
        return _range_line(group)
    near = [time.variant for time in group if time.low_ns <= fastest.high_ns]
    others = [time for time in group if time.variant not in near]
    names = listed(near) if len(near) <= MOST_NAMES else f"{len(near)} of {len(group)}"
    if not others:
        return f"No difference is clear: the quartiles of {names} overlap."
    slowest = others[-1]
    verb = "are the fastest, with quartiles that overlap" if len(near) > 1 else "is the fastest"
    factor = slowest.median_ns / fastest.median_ns
    return f"{names} {verb}; {slowest.variant} takes {factor:.2f} times as long."


def _range_line(group: Sequence[BenchmarkTime]) -> str:
    """Return the shortest and the longest time of a group that does different work."""
    ends = [
        f"{duration(time.median_ns)} ({time.variant})" if time.variant else duration(time.median_ns)
        for time in (group[0], group[-1])
    ]
    takes = f"A {group[0].per} takes"
    if len(group) == 1:
        return f"{takes} {ends[0]}."
    return f"{takes} {' to '.join(ends)}; they do other work, so none is the fastest."
