"""Find the commits or releases that changed how long something takes, by halving.

Both ends are compared first. Then the version in the middle is compared with the first one, and the
half in which the change lies is halved again. Each comparison is a verdict of `ab` or `versions`,
which has an error rate of its own. So the version that is found is compared with the one before it,
and the search begins again where the two do not differ.
"""

import math
import time
from collections import defaultdict, deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveInt
from mjbench.commands.versions import function_sides, function_verdict
from mjbench.commands.versions.function_sides import RevisionComparison
from mjbench.commands.versions.target_verdict import decide_targets
from mjbench.errors import InputError, MachineError
from mjbench.formats import listed, short_commit
from mjbench.host import platforms
from mjbench.paired import targets
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths import BASE
from mjbench.releases import catalogue, installs
from mjbench.releases.catalogue import ReleaseRange
from mjbench.releases.release_names import INSTALLED, ReleaseSpec
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, input_files
from mjbench.simulation.models import ModelSource
from mjbench.status import FINISHED, Status

# Comparisons beside those that halve: of the ends, and the one that confirms.
_OTHER_COMPARISONS = 2
# How often the first version that differs is searched for, where it is not confirmed.
_SEARCHES = 2
# Both sides of a change are searched where it leaves more than this share of the difference.
_REST = 0.3


class VersionKind(StrEnum):
    """What a search goes through."""

    COMMIT = "commit"
    """Of the user's code."""
    RELEASE = "release"
    """Of MuJoCo."""


@dataclass(frozen=True)
class VersionRow:
    """A commit, or a release.

    Attributes:
      number: after the baseline, from 1.
      name: the full hash of a commit, or a release such as 3.3.0.
      subject: the first line of a commit's message; empty for a release.
    """

    number: PositiveInt
    name: str
    subject: str = ""


@dataclass(frozen=True)
class BisectComparison:
    """A comparison of two versions.

    Attributes:
      first: the number of its baseline; 0 is the baseline of the search.
      verdict: None where a version could not be measured.
      detail: why it could not.
    """

    record_type: ClassVar[str] = "bisect_comparison"
    first: NonNegativeInt
    version: VersionRow
    verdict: VerdictRecord | None
    detail: str = ""
    seconds: NonNegativeFloat = 0.0


@dataclass(frozen=True)
class BisectChange:
    """A version that is slower, or faster, than the one before it.

    Attributes:
      skipped: versions right before it that could not be measured: the change may be theirs.
    """

    version: VersionRow
    verdict: VerdictRow
    skipped: Sequence[VersionRow] = ()


@dataclass(frozen=True, kw_only=True)
class BisectRecord:
    """A search for the commits or releases that changed how long something takes.

    Attributes:
      target: the function or the model, as the user named it.
      old: the baseline, as the user named it; `new` is the last version.
      versions: how many there are after the baseline, the last one included.
      ends: the verdict on the last version against the baseline; None without one.
      changes: in the order of their versions.
      detail: one line; empty when ok.
      seconds: of all comparisons, also of those before it was continued.
    """

    record_type: ClassVar[str] = "bisect"
    target: str
    old: str
    new: str
    versions: NonNegativeInt
    status: Status = Status.OK
    detail: str = ""
    ends: VerdictRow | None = None
    changes: Sequence[BisectChange] = ()
    seconds: NonNegativeFloat = 0.0
    kind: VersionKind = VersionKind.COMMIT


BisectMeasured = BisectComparison | BisectRecord
_Result = TypeVar("_Result")
# Yields comparisons on the way to a result.
_Steps = Generator[BisectComparison, None, _Result]
# Returns the verdict on a version against another one, by their numbers, with a multiple of the
# time limit. It raises InputError or MachineError where one of them cannot be measured.
Decide = Callable[[int, int, int], VerdictRecord]


def finished(records: Sequence[object]) -> list[BisectMeasured]:
    """Return the records of a run file that need not be measured again when it is continued.

    A version that could not be measured is tried again, unless the search has ended.
    """
    measured = [record for record in records if isinstance(record, BisectMeasured)]
    if any(isinstance(r, BisectRecord) and r.status in FINISHED for r in measured):
        return measured
    return [r for r in measured if isinstance(r, BisectComparison) and _is_decided(r)]


def _is_decided(comparison: BisectComparison) -> bool:
    return comparison.verdict is not None and comparison.verdict.verdict is not None


def short_name(version: VersionRow, kind: VersionKind) -> str:
    return short_commit(version.name) if kind == VersionKind.COMMIT else version.name


class Search:
    """One search: generators yield what is measured, and return what follows from it."""

    def __init__(
        self,
        decide: Decide,
        searched: BisectRecord,
        versions: Sequence[VersionRow],
        min_effect: float,
        earlier: Sequence[Record] = (),
        ready: Callable[[], Collection[int]] = list,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Prepare a search.

        Args:
          searched: what is searched for changes; the record of the search follows from it.
          versions: after the baseline, one or more.
          ready: returns the versions that need not be installed first.
        """
        self._decide, self._searched, self._versions = decide, searched, versions
        self._ready, self._clock = ready, clock
        self._log_effect = math.log1p(min_effect)
        self._known: dict[tuple[int, int], deque[BisectComparison]] = defaultdict(deque)
        for each in earlier:
            if isinstance(each, BisectComparison):
                self._known[each.first, each.version.number].append(each)
        self._unable: set[int] = set()
        self._changes: list[BisectChange] = []
        self._unconfirmed: list[VersionRow] = []
        self._seconds = 0.0

    def run(self) -> Iterator[BisectMeasured]:
        """Yield comparisons, and at last the record of the search."""
        count = len(self._versions)
        ends = yield from self._compare(0, count)
        assert ends is not None, "ends that cannot be measured raise an error"
        if _is_change(ends):
            yield from self._between(0, count, ends)
        yield replace(
            self._searched,
            status=ends.status,
            detail=ends.detail or self._detail(),
            ends=ends.row(),
            changes=sorted(self._changes, key=lambda change: change.version.number),
            seconds=self._seconds,
        )

    def _detail(self) -> str:
        """Return which versions were likely, and do not differ from those before them."""
        if not self._unconfirmed:
            return ""
        kind = self._searched.kind
        rows = dict.fromkeys(self._unconfirmed)
        names = listed([short_name(row, kind) for row in rows])
        return (
            f"likely, but not confirmed: {names}; there the change may be spread over several"
            f" {kind}s, each too small to be seen alone"
        )

    def _compare(self, first: int, last: int) -> _Steps[VerdictRecord | None]:
        """Return a verdict; one that stays inconclusive has had twice the time. None without."""
        record = None
        for effort in (1, 2):
            record = yield from self._measure(first, last, effort)
            if record is None or record.verdict != Verdict.INCONCLUSIVE:
                break
        return record

    def _measure(self, first: int, last: int, effort: int) -> _Steps[VerdictRecord | None]:
        known = self._known[first, last]
        if known:
            comparison = known.popleft()
        else:
            row, begin_s = self._versions[last - 1], self._clock()
            record, detail = None, ""
            try:
                record = self._decide(first, last, effort)
            except (InputError, MachineError) as error:
                if (first, last) == (0, len(self._versions)):
                    raise
                detail = str(error)
            comparison = BisectComparison(first, row, record, detail, self._clock() - begin_s)
            yield comparison
        self._seconds += comparison.seconds
        return comparison.verdict

    def _between(self, first: int, last: int, ends: VerdictRecord) -> _Steps[None]:
        """Find the changes between two versions that differ."""
        for _ in range(_SEARCHES):
            before, changed = yield from self._halve(first, last, ends)
            is_whole = (before, changed) == (first, last)
            change = ends if is_whole else (yield from self._compare(before, changed))
            versions = self._versions
            if change is None or not _is_change(change) or change.verdict != ends.verdict:
                self._unconfirmed.append(versions[changed - 1])
                continue
            skipped = versions[before : changed - 1]
            self._changes.append(BisectChange(versions[changed - 1], change.row(), skipped))
            self._unconfirmed.clear()
            rest = abs(_log_change(ends) - _log_change(change))
            if rest > max(self._log_effect, _REST * abs(_log_change(ends))):
                yield from self._beside((first, before), (changed, last))
            return

    def _beside(self, *sides: tuple[int, int]) -> _Steps[None]:
        """Search on the sides of a change that leaves something, where they differ."""
        for first, last in sides:
            ends = None if first == last else (yield from self._compare(first, last))
            if ends is not None and _is_change(ends):
                yield from self._between(first, last, ends)

    def _halve(self, first: int, last: int, ends: VerdictRecord) -> _Steps[tuple[int, int]]:
        """Return a version like the first, and the next one that can be measured, like the last."""
        low, high = first, last
        while (middle := self._middle(low, high)) is not None:
            record = yield from self._compare(first, middle)
            if record is None or record.verdict is None or record.ratio is None:
                self._unable.add(middle)
                continue
            is_changed = record.verdict == ends.verdict
            if record.verdict == Verdict.INCONCLUSIVE:  # the nearer one is the likelier one
                change = _log_change(record)
                is_changed = abs(_log_change(ends) - change) < abs(change)
            low, high = (low, middle) if is_changed else (middle, high)
        return low, high

    def _middle(self, low: int, high: int) -> int | None:
        """Return the version to measure; one that is ready if it is in the middle half."""
        middle, reach, ready = (low + high) / 2, (high - low) / 4, self._ready()
        return min(
            (number for number in range(low + 1, high) if number not in self._unable),
            key=lambda n: (n not in ready or abs(n - middle) > reach, abs(n - middle)),
            default=None,
        )


def _is_change(record: VerdictRecord) -> bool:
    return record.verdict in (Verdict.SLOWER, Verdict.FASTER) and record.ratio is not None


def _log_change(record: VerdictRecord) -> float:
    assert record.ratio is not None, "a change has a ratio"
    return math.log(record.ratio.estimate)


def expected_comparisons(versions: int) -> int:
    """Return about how many verdicts find one change among versions after the baseline."""
    return _OTHER_COMPARISONS + math.ceil(math.log2(max(1, versions)))


def search_releases(
    releases: ReleaseRange,
    source: ModelSource,
    plan: VerdictPlan,
    on_phase: Callable[[str], None] = lambda text: None,
    earlier: Sequence[Record] = (),
) -> Iterator[BisectMeasured]:
    """Yield what is measured, and which releases changed what is compared of a model."""
    versions = [release.version for release in releases.specs]
    shares = plan.budget.divided(expected_comparisons(len(versions) - 1), on_phase)

    def ready() -> set[int]:
        names = installs.install_names()
        specs = enumerate(releases.specs)
        return {n for n, each in specs if each.name == INSTALLED or each.key in names}

    def decide(first: int, last: int, effort: int) -> VerdictRecord:
        if releases.index_problem and last not in ready():
            raise MachineError(f"not installed here, and {releases.index_problem}")
        on_phase(f"comparing {versions[first]} and {versions[last]}")
        old, new = (Target(releases.specs[number], source) for number in (first, last))
        timed = replace(plan, time_limit_s=shares.next_s(effort))
        return decide_targets(pool, old, new, timed).uninterrupted()

    rows = [VersionRow(number, name) for number, name in enumerate(versions) if number]
    searched = BisectRecord(
        target=source.name,
        kind=VersionKind.RELEASE,
        old=versions[0],
        new=versions[-1],
        versions=len(rows),
    )
    with WorkerPool() as pool:
        yield from Search(decide, searched, rows, plan.min_effect, earlier, ready).run()


def search_revisions(
    comparison: RevisionComparison,
    plan: VerdictPlan,
    on_phase: Callable[[str], None] = lambda text: None,
    earlier: Sequence[Record] = (),
) -> Iterator[BisectMeasured]:
    """Yield what is measured, and which commits changed the time of a function.

    Raises:
      InputError: the candidate does not come after the baseline.
    """
    old, new, repository = comparison.baseline, comparison.candidate, comparison.repository
    commits = repository.history(old, new)
    (function,) = comparison.functions
    if not comparison.own_files:  # all commits are measured by one benchmark
        function = replace(function, content=repository.text(new, function.file))
    revisions = [old, *(each.revision for each in commits)]
    shares = plan.budget.divided(expected_comparisons(len(commits)), on_phase)

    def decide(first: int, last: int, effort: int) -> VerdictRecord:
        baseline, candidate = revisions[first], revisions[last]
        pair = replace(comparison, baseline=baseline, candidate=candidate, functions=[function])
        on_phase(f"comparing {baseline.name} and {candidate.name}")
        timed = replace(plan, time_limit_s=shares.next_s(effort))
        with WorkerPool() as pool:
            (targets,) = function_sides.check_out(pool, pair)
            return function_verdict.decide_function(pool, targets, timed).uninterrupted()

    rows = [VersionRow(n, each.commit, each.subject) for n, each in enumerate(commits, 1)]
    searched = BisectRecord(target=function.text, old=old.name, new=new.name, versions=len(commits))
    return Search(decide, searched, rows, plan.min_effect, earlier).run()


# -- as measurements --------------------------------------------------------------------------

# Yields what is measured; called with what shows the text of a phase, and with earlier records.
_Search = Callable[[Callable[[str], None], Sequence[Record]], Iterator[BisectMeasured]]


def revision_bisection(comparison: RevisionComparison, plan: VerdictPlan) -> Measurement:
    plan = replace(plan, as_shipped=True)
    (function,) = comparison.functions
    return _measurement(
        lambda *observers: search_revisions(comparison, plan, *observers),
        VersionKind.COMMIT,
        {
            **asdict(plan),
            "revisions": [asdict(each) for each in (comparison.baseline, comparison.candidate)],
            "function": function.text,
            "own_files": comparison.own_files,
        },
        comparison.files,
    )


def release_bisection(
    baseline: ReleaseSpec, candidate: ReleaseSpec, source: ModelSource, plan: VerdictPlan
) -> Measurement:
    """Return the search between two releases; InputError for packages, or another metric."""
    if baseline.has_packages or candidate.has_packages:
        raise InputError(
            "bisect searches releases of MuJoCo alone: `mjbench versions` has packages"
        )
    targets.check_metric(plan.sizes.metric, [BASE])
    releases = catalogue.releases_between(baseline, candidate)
    measurement = _measurement(
        lambda *observers: search_releases(releases, source, plan, *observers),
        VersionKind.RELEASE,
        {
            **asdict(plan),
            "releases": [release.key for release in releases.specs],
            "model": source.name,
        },
        input_files([source], releases.specs, plan.sizes.starts),
    )
    return replace(measurement, notes=[*releases.notes, *measurement.notes])


def _measurement(
    search: _Search, kind: VersionKind, arguments: Mapping[str, Any], files: Sequence[Path]
) -> Measurement:
    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        if any(isinstance(record, BisectRecord) for record in earlier):
            return
        expected = 0
        for number, record in enumerate(search(observer.begin, earlier), 1):
            yield Item([record])
            if isinstance(record, BisectComparison):
                expected = expected or expected_comparisons(record.version.number)
                text = short_name(record.version, kind)
                observer(text, number / max(expected, number + 1))

    return Measurement("bisect", arguments, files, measure, finished, platforms.pinning_notes())
