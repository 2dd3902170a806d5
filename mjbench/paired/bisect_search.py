"""Find the commits or releases that changed how long something takes, from few of them.

Both ends are compared first. Versions in between are then measured a few times each, where that
tells most (see `measuring.bisection`), until one is probably the first that differs. A fresh
comparison of this version with the one before it decides. Where it explains too little of the
difference between the ends, both sides of it are searched.
"""

import contextlib
import math
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from mjbench.errors import InputError, MachineError
from mjbench.measuring.bisection import ChangePosterior, VersionRatio
from mjbench.paired.bisect_records import (
    BisectChange,
    BisectComparison,
    BisectMeasured,
    BisectRecord,
    BisectTrial,
    VersionKind,
    VersionRow,
)
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.verdict import launches_to_judge
from mjbench.store.runs import Record
from mjbench.units import listed, short_commit

_Result = TypeVar("_Result")
# Yields what is measured on the way to a result.
_Steps = Generator[BisectTrial | BisectComparison, None, _Result]

# The probability at which a version is compared with the one before it.
CERTAINTY = 0.99
# Launches of a version that is measured, and how often versions are measured in a search, at most.
LAUNCHES, MOST_TRIALS = 3, 40
# The sides of a change are searched where it leaves more than this share of the difference.
_REST = 0.3
# The standard deviation of normal samples over the mean of their absolute differences.
_MEAN_DISTANCES = math.sqrt(math.pi / 2)
# No launch is more precise, in log ratio: differences between versions are not noise alone.
_LEAST_DEVIATION = 0.003


class VersionMeasurer(ABC):
    """Measures versions, which have numbers; the baseline is 0."""

    @abstractmethod
    def decide(self, baseline: int, candidate: int) -> VerdictRecord:
        """Return the verdict on a version against another.

        Raises:
          MachineError: one of them cannot be built, or is not what would be measured.
        """

    @abstractmethod
    def log_ratios(self, baseline: int, candidate: int, count: int) -> Sequence[float]:
        """Return the log ratios of a few launches.

        Raises:
          InputError: the version cannot do it, or does other work.
          MachineError: it cannot be built or installed, crashed or failed.
        """

    def ready(self) -> Collection[int]:
        """Return the versions that need not be built or installed first."""
        return ()


@dataclass(frozen=True)
class SearchRange:
    """What is searched for changes: `versions` after the baseline, one or more, up to `new`."""

    target: str
    kind: VersionKind
    old: str
    new: str
    versions: Sequence[VersionRow]


def search(
    measurer: VersionMeasurer,
    searched: SearchRange,
    min_effect: float,
    earlier: Sequence[Record] = (),
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[BisectMeasured]:
    """Yield what is measured; the last record says which versions changed the time of something."""
    return _Searcher(measurer, searched, min_effect, earlier, clock).run()


def short_name(version: VersionRow, kind: VersionKind) -> str:
    return short_commit(version.name) if kind == VersionKind.COMMIT else version.name


class _Searcher:
    """One search: generators yield what is measured, and return what follows from it."""

    def __init__(
        self,
        measurer: VersionMeasurer,
        searched: SearchRange,
        min_effect: float,
        earlier: Sequence[Record],
        clock: Callable[[], float],
    ):
        self._measurer, self._searched, self._clock = measurer, searched, clock
        self._versions = searched.versions
        self._log_effect = math.log1p(min_effect)
        self._known_trials = deque(each for each in earlier if isinstance(each, BisectTrial))
        self._known_comparisons = {
            (each.first, each.last): each for each in earlier if isinstance(each, BisectComparison)
        }
        self._unable: set[int] = set()
        self._trials: list[BisectTrial] = []
        self._changes: list[BisectChange] = []
        self._unconfirmed: list[VersionRow] = []
        self._seconds = 0.0

    def run(self) -> Iterator[BisectMeasured]:
        searched, count = self._searched, len(self._versions)
        ends = yield from self._decide(0, count)
        if _is_change(ends):
            yield from self._between(0, count, ends)
        yield BisectRecord(
            target=searched.target,
            kind=searched.kind,
            old=searched.old,
            new=searched.new,
            versions=count,
            status=ends.status,
            detail=ends.detail or self._detail(),
            ends=ends.row(),
            trials=self._trials,
            changes=sorted(self._changes, key=lambda change: change.version.number),
            seconds=self._seconds,
        )

    def _detail(self) -> str:
        """Return which versions were likely, and do not differ from those before them."""
        if not self._unconfirmed:
            return ""
        kind = self._searched.kind
        names = listed([short_name(row, kind) for row in self._unconfirmed])
        return (
            f"likely, but not confirmed: {names}; there the change may be spread over several"
            f" {kind}s, each too small to be seen alone"
        )

    def _decide(self, first: int, last: int) -> _Steps[VerdictRecord]:
        comparison = self._known_comparisons.get((first, last))
        if comparison is None:
            begin_s = self._clock()
            verdict = self._measurer.decide(first, last)
            comparison = BisectComparison(first, last, verdict, self._clock() - begin_s)
            yield comparison
        self._seconds += comparison.seconds
        return comparison.verdict

    def _between(self, first: int, last: int, ends: VerdictRecord) -> _Steps[None]:
        """Find the changes between two versions that differ."""
        changed = yield from self._likeliest(first, last, ends)
        if changed is None:  # the last one measured lies between two changes
            middle = self._trials[-1].version.number
            yield from self._search_each((first, middle), (middle, last))
            return
        before, verdict = first, ends
        if last - first > 1:
            before, verdict = yield from self._beside(first, changed)
        row = self._versions[changed - 1]
        if not _is_change(verdict):
            self._unconfirmed.append(row)
            return
        self._changes.append(BisectChange(row, verdict.row(), self._versions[before : changed - 1]))
        if (before, changed) != (first, last) and self._leaves_more(ends, verdict):
            yield from self._search_each((first, before), (changed, last))

    def _search_each(self, *sides: tuple[int, int]) -> _Steps[None]:
        """Search between versions, where they differ."""
        for first, last in sides:
            if first == last:
                continue
            ends = yield from self._decide(first, last)
            if _is_change(ends):
                yield from self._between(first, last, ends)

    def _beside(self, first: int, changed: int) -> _Steps[tuple[int, VerdictRecord]]:
        """Return the last version before one that can be measured, and the verdict on the two."""
        for before in range(changed - 1, first, -1):
            if before in self._unable:
                continue
            with contextlib.suppress(MachineError):
                verdict = yield from self._decide(before, changed)
                if verdict.verdict is not None:
                    return before, verdict
            self._unable.add(before)
        return first, (yield from self._decide(first, changed))

    def _likeliest(self, first: int, last: int, ends: VerdictRecord) -> _Steps[int | None]:
        """Measure versions between two until one is probably the first that differs; return it.

        Where that one cannot be measured, it is the next one that can.

        Returns:
          None where the version that was measured last is like neither end.
        """
        samples = [launch.log_ratio for launch in launches_to_judge(ends.samples)]
        residuals = list(np.asarray(samples) - np.median(samples))
        point = ChangePosterior(last - first, _log_change(ends), _deviation(residuals))
        for _ in range(MOST_TRIALS):
            unable = {number - first for number in self._unable}
            ready = {number - first for number in self._measurer.ready()}
            is_certain = point.certainty >= CERTAINTY
            version = None if is_certain else point.next_version(unable, ready)
            if version is None:
                break
            trial = self._next_known(first, last)
            if trial is None:
                trial = self._measured(first, first + version)
                yield trial
            self._trials.append(trial)
            self._seconds += trial.seconds
            version, log_ratios = trial.version.number - first, trial.log_ratios
            if not log_ratios:
                self._unable.add(trial.version.number)
                continue
            residuals += _residuals(log_ratios)
            observation = VersionRatio(version, float(np.mean(log_ratios)))
            observations = [*point.observations, observation]
            point = replace(point, deviation=_deviation(residuals), observations=observations)
            if point.is_between(observation.log_ratio):
                return None
        changed = first + point.likeliest
        while changed < last and changed in self._unable:
            changed += 1
        return changed

    def _next_known(self, first: int, last: int) -> BisectTrial | None:
        """Return the next trial of the search that is continued: once each, as it measured them."""
        known = self._known_trials
        if known and known[0].first == first and first < known[0].version.number <= last:
            return known.popleft()
        return None

    def _measured(self, first: int, number: int) -> BisectTrial:
        row, begin_s = self._versions[number - 1], self._clock()
        log_ratios, detail = list[float](), ""
        try:
            log_ratios += self._measurer.log_ratios(first, number, LAUNCHES)
        except (InputError, MachineError) as error:
            detail = str(error)
        return BisectTrial(
            row,
            detail,
            first=first,
            log_ratios=log_ratios,
            seconds=self._clock() - begin_s,
        )

    def _leaves_more(self, ends: VerdictRecord, change: VerdictRecord) -> bool:
        """Return whether there may be another change: comparisons of both sides decide."""
        whole = _log_change(ends)
        rest = abs(whole - _log_change(change))
        return rest > max(self._log_effect, _REST * abs(whole))


def _is_change(record: VerdictRecord) -> bool:
    return record.verdict in (Verdict.SLOWER, Verdict.FASTER) and record.ratio is not None


def _log_change(record: VerdictRecord) -> float:
    assert record.ratio is not None, "a change has a ratio"
    return math.log(record.ratio.estimate)


def _residuals(log_ratios: Sequence[float]) -> list[float]:
    """Return how far launches of one version are from their mean, as far as from the truth."""
    count, values = len(log_ratios), np.asarray(log_ratios)
    return list((values - values.mean()) * math.sqrt(count / max(count - 1, 1)))


def _deviation(residuals: Sequence[float]) -> float:
    """Return the deviation of a version's mean, from launches; robust, as some are disturbed."""
    launch = _MEAN_DISTANCES * float(np.mean(np.abs(residuals)))
    return max(launch, _LEAST_DEVIATION) / math.sqrt(LAUNCHES)
