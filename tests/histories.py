"""Small histories of six releases, as asv's results would give them."""

from collections.abc import Sequence

from mjbench.releases.benchmark_names import BenchmarkName
from mjbench.releases.history import AsvMachine, History, Point, Series

VERSIONS = ["1.0", "1.1", "1.2", "1.3", "1.4", "1.5"]


def timed(*values: float | None, rounds: Sequence[tuple[float, ...]] | None = None) -> Series:
    """Return a series of step times in seconds, both rounds alike unless `rounds` are given."""
    points = {}
    for i, (version, value) in enumerate(zip(VERSIONS, values, strict=False)):
        both = (value,) * 2 if value else ()
        points[version] = Point(value, both if rounds is None else rounds[i])
    return Series(BenchmarkName.STEP_TIME, "1000 × mj_step", {"model": "pole"}, points)


def counted(benchmark: str, *values: float) -> Series:
    points = {version: Point(value) for version, value in zip(VERSIONS, values, strict=False)}
    return Series(benchmark, benchmark, {"model": "pole"}, points)


def history(*series: Series) -> History:
    return History(AsvMachine(machine="here"), VERSIONS, series)
