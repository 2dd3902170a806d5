"""Find the commits that changed how long a function takes, from few of them.

Both ends are compared first. Commits in between are then measured a few times each, where that
tells most (see `measuring.bisection`), until one is probably the first that differs. A fresh
comparison of this commit with the one before it decides. Where it explains too little of the
difference between the ends, both sides of it are searched.
"""

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjbench.errors import InputError, MachineError
from mjbench.measuring.bisection import ChangePosterior, VersionRatio
from mjbench.paired.bisect_records import BisectChange, BisectTrial, CommitRow
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord
from mjbench.units import listed, short_commit

# The probability at which a commit is compared with the one before it.
CERTAINTY = 0.99
# Launches of a commit that is measured, and how often commits are measured in a search, at most.
LAUNCHES, MOST_TRIALS = 3, 40
# The sides of a change are searched where it leaves more than this share of the difference.
_REST = 1 / 3
# No launch is more precise, in log ratio: differences between commits are not noise alone.
_LEAST_DEVIATION = 0.003


class CommitMeasurer(ABC):
    """Measures commits, which have numbers; the baseline is 0."""

    @abstractmethod
    def decide(self, baseline: int, candidate: int) -> VerdictRecord:
        """Return the verdict on a commit against another.

        Raises:
          MachineError: one of them cannot be built, or is not what would be measured.
        """

    @abstractmethod
    def log_ratios(self, baseline: int, candidate: int, count: int) -> Sequence[float]:
        """Return the log ratios of a few launches.

        Raises:
          InputError: the commit cannot do it, or does other work.
          MachineError: it cannot be built, crashed or failed.
        """


@dataclass(frozen=True)
class BisectResult:
    """What a search came to.

    Attributes:
      ends: the verdict on the first and the last of all commits.
      detail: what could not be decided; empty where all was.
    """

    ends: VerdictRecord
    trials: Sequence[BisectTrial] = ()
    changes: Sequence[BisectChange] = ()
    detail: str = ""


def search(
    measurer: CommitMeasurer,
    commits: Sequence[CommitRow],
    min_effect: float,
    on_trial: Callable[[BisectTrial], None] = lambda trial: None,
) -> BisectResult:
    """Return which commits changed the time of a function.

    Args:
      commits: after the baseline, one or more, the last one included.
      min_effect: smallest change that matters, as a share.
    """
    return _Searcher(measurer, commits, min_effect, on_trial).run()


class _Searcher:
    """One search, and its results."""

    def __init__(
        self,
        measurer: CommitMeasurer,
        commits: Sequence[CommitRow],
        min_effect: float,
        on_trial: Callable[[BisectTrial], None],
    ):
        self._measurer, self._commits, self._on_trial = measurer, commits, on_trial
        self._log_effect = math.log1p(min_effect)
        self._unable: set[int] = set()
        self._trials: list[BisectTrial] = []
        self._changes: list[BisectChange] = []
        self._unconfirmed: list[CommitRow] = []

    def run(self) -> BisectResult:
        ends = self._measurer.decide(0, len(self._commits))
        if _is_change(ends):
            self._between(0, len(self._commits), ends)
        self._changes.sort(key=lambda change: change.commit.number)
        return BisectResult(ends, self._trials, self._changes, self._detail())

    def _detail(self) -> str:
        """Return which commits were likely, and do not differ from those before them."""
        if not self._unconfirmed:
            return ""
        names = listed([short_commit(row.commit) for row in self._unconfirmed])
        return (
            f"likely, but not confirmed: {names}; there the change may be spread over several"
            " commits, each too small to be seen alone"
        )

    def _between(self, first: int, last: int, ends: VerdictRecord) -> None:
        """Find the changes between two commits that differ."""
        changed = self._likeliest(first, last, ends)
        if changed is None:  # the last one measured lies between two changes
            middle = self._trials[-1].commit.number
            self._search_each((first, middle), (middle, last))
            return
        before, verdict = (first, ends) if last - first == 1 else self._beside(first, changed)
        row = self._commits[changed - 1]
        if not _is_change(verdict):
            self._unconfirmed.append(row)
            return
        self._changes.append(BisectChange(row, verdict.row(), self._commits[before : changed - 1]))
        if (before, changed) != (first, last) and self._leaves_more(ends, verdict):
            self._search_each((first, before), (changed, last))

    def _search_each(self, *sides: tuple[int, int]) -> None:
        """Search between commits, where they differ."""
        for first, last in sides:
            ends = self._measurer.decide(first, last) if first < last else None
            if ends is not None and _is_change(ends):
                self._between(first, last, ends)

    def _beside(self, first: int, changed: int) -> tuple[int, VerdictRecord]:
        """Return the last commit before one that can be measured, and the verdict on the two."""
        for before in range(changed - 1, first, -1):
            if before in self._unable:
                continue
            with contextlib.suppress(MachineError):
                verdict = self._measurer.decide(before, changed)
                if verdict.verdict is not None:
                    return before, verdict
            self._unable.add(before)
        return first, self._measurer.decide(first, changed)

    def _likeliest(self, first: int, last: int, ends: VerdictRecord) -> int | None:
        """Measure commits between two until one is probably the first that differs; return it.

        Where that one cannot be measured, it is the next one that can.

        Returns:
          None where the commit that was measured last is like neither end.
        """
        deviation = _deviation([launch.log_ratio for launch in ends.samples])
        point = ChangePosterior(last - first, _log_change(ends), deviation / math.sqrt(LAUNCHES))
        for _ in range(MOST_TRIALS):
            unable = {number - first for number in self._unable}
            version = None if point.certainty >= CERTAINTY else point.next_version(unable)
            if version is None:
                break
            log_ratio = self._measure(first, first + version)
            if log_ratio is None:
                continue
            if point.is_between(log_ratio):
                return None
            observation = VersionRatio(version, log_ratio)
            point = replace(point, observations=[*point.observations, observation])
        changed = first + point.likeliest
        while changed < last and changed in self._unable:
            changed += 1
        return changed

    def _measure(self, first: int, number: int) -> float | None:
        """Return the log ratio of a commit; None where it cannot be measured."""
        row, log_ratio = self._commits[number - 1], None
        try:
            log_ratios = self._measurer.log_ratios(first, number, LAUNCHES)
            log_ratio = float(np.mean(log_ratios))
            trial = BisectTrial(row, "", math.exp(log_ratio), len(log_ratios))
        except (InputError, MachineError) as error:
            self._unable.add(number)
            trial = BisectTrial(row, str(error))
        self._trials.append(trial)
        self._on_trial(trial)
        return log_ratio

    def _leaves_more(self, ends: VerdictRecord, change: VerdictRecord) -> bool:
        """Return whether there may be another change: comparisons of both sides decide."""
        whole = _log_change(ends)
        rest = abs(whole - _log_change(change))
        return rest > max(self._log_effect, _REST * abs(whole))


def _is_change(record: VerdictRecord) -> bool:
    return record.verdict in (Verdict.SLOWER, Verdict.FASTER) and record.ratio is not None


def _log_change(record: VerdictRecord) -> float:
    """Return the log ratio of a change."""
    assert record.ratio is not None, "a change has a ratio"
    return math.log(record.ratio.estimate)


def _deviation(log_ratios: Sequence[float]) -> float:
    """Return the deviation of a launch; robust, because some are disturbed."""
    values = np.asarray(log_ratios)
    median = np.median(values)
    return max(1.4826 * float(np.median(np.abs(values - median))), _LEAST_DEVIATION)
