"""What changed between releases, by asv's results: change points, changed work, missing values.

A change point is a change between two neighbouring releases: of the paired ratio to a reference
release, or of an unpaired time, if every round shows it and the releases around it stand apart.
"""

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from mjbench.releases.benchmark_names import STEP_TIMES, WORK_COUNTERS, BenchmarkName
from mjbench.simulation import agreement

# The smallest change of a time that counts as a change point.
THRESHOLD = 0.05
# Releases on each side of a change point that must all lie on their side of it.
NEIGHBOURS = 3
# The smallest change of a count of instructions that is marked.
COUNT_THRESHOLD = 0.01


@dataclass(frozen=True)
class Point:
    """One benchmark of one release.

    Attributes:
      value: seconds of one call, bytes, or a count; NaN where the benchmark does not apply, None
        where it failed.
      rounds: the median of each round's samples, in the order they were taken; empty for counts.
    """

    value: float | None
    rounds: tuple[float, ...] = ()

    @property
    def is_measured(self) -> bool:
        """Return whether there is a number."""
        return self.value is not None and not math.isnan(self.value)


@dataclass(frozen=True)
class Series:
    """One benchmark with one choice of parameters, over the releases.

    Attributes:
      benchmark: its name, such as `step.Step.time_1000_steps`.
      title: the name for readers.
      params: the parameters by name.
      points: by version, in upload order.
    """

    benchmark: str
    title: str
    params: Mapping[str, str]
    points: Mapping[str, Point]

    @property
    def is_timed(self) -> bool:
        """Return whether its values are seconds."""
        return bool(re.search(r"\.time(raw)?_", self.benchmark))

    @property
    def repeats(self) -> int:
        """Return how often one call repeats what is timed: the number in the benchmark's name."""
        number = re.search(r"\.time_(\d+)_", self.benchmark)
        return int(number[1]) if number else 1

    @property
    def label(self) -> str:
        """Return the parameters as people write them."""
        return ", ".join(self.params.values())


@dataclass(frozen=True, kw_only=True)
class AsvMachine:
    """What asv knows of a machine, as text; empty where it does not.

    Attributes:
      machine: its name in asv.
      cpu: its processor.
      arch: the processor's architecture.
      os: its operating system.
      num_cpu: number of cores.
    """

    machine: str
    cpu: str = ""
    arch: str = ""
    os: str = ""
    num_cpu: str = ""


@dataclass(frozen=True)
class History:
    """What asv measured on one machine.

    Attributes:
      machine: that it ran on.
      versions: the releases measured, in upload order.
      series: every benchmark and choice of parameters.
    """

    machine: AsvMachine
    versions: Sequence[str]
    series: Sequence[Series]

    def find(self, benchmark: str, **params: str) -> Series | None:
        """Return the series of a benchmark with these parameters, or None."""
        for series in self.series:
            if series.benchmark == benchmark and dict(series.params) == params:
                return series
        return None

    def value(self, benchmark: str, model: str, version: str) -> float | None:
        """Return a benchmark's value for a model and a release; None where there is no number."""
        series = self.find(benchmark, model=model)
        point = series.points.get(version) if series else None
        return point.value if point and point.is_measured else None


@dataclass(frozen=True)
class ChangePoint:
    """A change between two neighbouring releases.

    Attributes:
      series: the series that changed.
      previous: the last release before it.
      release: the first release with it.
      ratio: the new value over the previous one.
      rounds: the ratio of each round; empty for a series without rounds.
    """

    series: Series
    previous: str
    release: str
    ratio: float
    rounds: tuple[float, ...]


class GapReason(StrEnum):
    """Why a benchmark has no number for a release."""

    FAILED = "failed"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True)
class Gap:
    """Releases without a number in one series.

    Attributes:
      title: the benchmark's name for readers.
      label: its parameters as people write them.
      versions: the releases, in upload order.
      reason: why there is no number.
    """

    title: str
    label: str
    versions: tuple[str, ...]
    reason: GapReason


def unpaired_change_points(history: History, threshold: float = THRESHOLD) -> list[ChangePoint]:
    """Return the change points of all timed series, by release and then the largest first.

    An unpaired time of a release is the smaller of its rounds' medians, since whatever disturbs a
    process only adds time. A change point is a change by more than `threshold` from one release to
    the next, in the same direction in every round, after which up to NEIGHBOURS releases all lie
    on the other side of all of the NEIGHBOURS before. One odd release is no change point.
    """
    points = [
        change_point
        for series in history.series
        if series.is_timed
        for change_point in _unpaired_in(series, threshold)
    ]
    return _sorted_by_release(history, points)


def _unpaired_in(series: Series, threshold: float) -> Iterator[ChangePoint]:
    measured = [(v, p) for v, p in series.points.items() if p.is_measured]
    values = [min(p.rounds or (float(p.value or 0.0),)) for _, p in measured]
    smallest = math.log1p(threshold)
    for i in range(1, len(measured)):
        (previous, point_before), (release, point) = measured[i - 1], measured[i]
        ratio = values[i] / values[i - 1]
        rounds = tuple(b / a for a, b in zip(point_before.rounds, point.rounds, strict=False))
        before, after = values[max(0, i - NEIGHBOURS) : i], values[i : i + NEIGHBOURS]
        logs = [math.log(r) for r in (ratio, *rounds)]
        is_slower = min(after) > max(before) and all(x > smallest for x in logs)
        is_faster = max(after) < min(before) and all(x < -smallest for x in logs)
        if is_slower or is_faster:
            yield ChangePoint(series, previous, release, ratio, rounds)


def paired_change_points(history: History, threshold: float = THRESHOLD) -> list[ChangePoint]:
    """Return the change points of the paired ratio to the reference release, by release.

    A change point is a change by more than `threshold` from one release to the next, of which the
    unpaired times show at least half in some round. Its rounds are those of the unpaired times.
    """
    points = [
        change_point
        for series in history.series
        if series.benchmark == BenchmarkName.RATIO_TO_REFERENCE
        for change_point in _paired_in(history, series, threshold)
    ]
    return _sorted_by_release(history, points)


def _paired_in(history: History, series: Series, threshold: float) -> Iterator[ChangePoint]:
    measured = [(v, float(p.value or 0.0)) for v, p in series.points.items() if p.is_measured]
    for (previous, before), (release, after) in itertools.pairwise(measured):
        change = math.log(after / before)
        direction = math.copysign(1, change)
        rounds = unpaired_ratios(history, series.params["model"], previous, release)
        is_confirmed = any(math.log(r) * direction > abs(change) / 2 for r in rounds)
        if is_confirmed and abs(change) > math.log1p(threshold):
            yield ChangePoint(series, previous, release, after / before, rounds)


def _sorted_by_release(history: History, points: Sequence[ChangePoint]) -> list[ChangePoint]:
    """Return change points by release, those of one release by their size, the largest first."""
    position = {version: i for i, version in enumerate(history.versions)}
    return sorted(points, key=lambda p: (position[p.release], -abs(math.log(p.ratio))))


def unpaired_ratios(history: History, model: str, previous: str, release: str) -> tuple[float, ...]:
    """Return by what factor the time of a model's step changed, round by round.

    It is empty where one of the two releases was not timed.
    """
    for benchmark in STEP_TIMES:
        series = history.find(benchmark, model=model)
        if series is None:
            continue
        before, after = series.points.get(previous), series.points.get(release)
        if before and after:
            return tuple(b / a for a, b in zip(before.rounds, after.rounds, strict=False))
    return ()


def count_ratio(history: History, model: str, previous: str, release: str) -> float | None:
    """Return by what factor the instructions of a model's step changed; None if not counted."""
    before = history.value(BenchmarkName.INSTRUCTIONS, model, previous)
    after = history.value(BenchmarkName.INSTRUCTIONS, model, release)
    return after / before if before and after else None


def work_changes(history: History, model: str, previous: str, release: str) -> list[str]:
    """Describe how the work of a model's step changed between two releases.

    Returns:
      Descriptions such as `contacts 1 → 5`, the counters first, and then whether one step gives
      another result. For that the drift of both releases is compared, which is the difference to
      the reference release: where it differs, one of the two computes something else.
    """
    before, after = (_work(history, model, version) for version in (previous, release))
    descriptions = agreement.counter_changes(before, after)
    drift_before = history.value(BenchmarkName.DRIFT, model, previous)
    drift_after = history.value(BenchmarkName.DRIFT, model, release)
    return descriptions + agreement.result_changes(drift_before, drift_after)


def _work(history: History, model: str, version: str) -> dict[str, float]:
    """Return the counters of a model's work that were measured, by name."""
    values = {
        name: history.value(benchmark, model, version) for name, benchmark in WORK_COUNTERS.items()
    }
    return {name: value for name, value in values.items() if value is not None}


def gaps(history: History) -> list[Gap]:
    """Return where benchmarks have no number, series by series."""
    missing = []
    for series in history.series:
        versions_by_reason: dict[GapReason, list[str]] = {}
        for version, point in series.points.items():
            if not point.is_measured:
                reason = GapReason.FAILED if point.value is None else GapReason.NOT_APPLICABLE
                versions_by_reason.setdefault(reason, []).append(version)
        missing += [
            Gap(series.title, series.label, tuple(versions), reason)
            for reason, versions in versions_by_reason.items()
        ]
    return missing
