"""The versions that changed the time of something; verdicts are invented, and some are wrong."""

import itertools
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from git_checkout import commit, new_repository
from verdict_records import FAILED, SAME, SLOWER

from mjbench.commands.versions import bisect, function_verdict
from mjbench.commands.versions.bisect import (
    BisectComparison,
    BisectMeasured,
    BisectRecord,
    Search,
    VersionKind,
    VersionRow,
    finished,
)
from mjbench.commands.versions.function_sides import (
    FunctionTargets,
    RevisionComparison,
    parse_function,
)
from mjbench.errors import InputError, MachineError
from mjbench.interval import Interval
from mjbench.paired import verdict
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.releases import installs
from mjbench.releases.catalogue import ReleaseRange
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import Repository
from mjbench.simulation import models
from mjbench.status import Status


@dataclass
class Invented:
    """Verdicts on versions whose times are known.

    Attributes:
      steps: log ratio of a version over the one before it, by its number.
      broken: versions that cannot be built; `failing`: those that end without a verdict.
      wrong: verdicts that are not the true ones, by the number of the comparison.
      open: comparisons that are inconclusive, and whether also with twice the time.
    """

    steps: dict[int, float]
    broken: Collection[int] = ()
    failing: Collection[int] = ()
    wrong: dict[int, Verdict] = field(default_factory=dict)
    open: dict[tuple[int, int], bool] = field(default_factory=dict)
    decided: list[tuple[int, int, int]] = field(default_factory=list)

    def decide(self, first: int, last: int, effort: int) -> VerdictRecord:
        self.decided.append((first, last, effort))
        if {first, last} & set(self.broken):
            raise MachineError("cannot build it")
        if {first, last} & set(self.failing):
            return FAILED
        truth = sum(step for number, step in self.steps.items() if first < number <= last)
        true = Verdict.SLOWER if truth > 0 else Verdict.FASTER
        true = true if abs(truth) > 0.005 else Verdict.SAME
        if (first, last) in self.open and (effort == 1 or self.open[first, last]):
            true = Verdict.INCONCLUSIVE
        shown = self.wrong.get(len(self.decided), true)
        return replace(SAME, verdict=shown, ratio=Interval(math.exp(truth), None, None))


def search(
    invented: Invented,
    count: int,
    earlier: Sequence[BisectMeasured] = (),
    ready: Collection[int] = (),
) -> Iterator[BisectMeasured]:
    commits = [VersionRow(n, f"{n:040x}", f"commit {n}") for n in range(1, count + 1)]
    searched = BisectRecord(target="bench.py::step", old="old", new="new", versions=count)
    ticks = itertools.count()
    return Search(
        *(invented.decide, searched, commits, 0.01, earlier),
        *(lambda: ready, lambda: float(next(ticks))),
    ).run()


def result_of(invented: Invented, count: int, ready: Collection[int] = ()) -> BisectRecord:
    *_, record = search(invented, count, ready=ready)
    assert isinstance(record, BisectRecord)
    return record


def changed(record: BisectRecord) -> list[int]:
    return [change.version.number for change in record.changes]


# the search


@pytest.mark.parametrize("truth", range(1, 65))
def test_the_first_slower_commit_is_found_among_64(truth: int) -> None:
    invented = Invented({truth: 0.05})
    result = result_of(invented, 64)
    assert changed(result) == [truth]
    assert result.changes[0].verdict.verdict == Verdict.SLOWER
    assert invented.decided[0] == (0, 64, 1)
    assert invented.decided[-1] == (truth - 1, truth, 1), "compared with the one before it"
    assert len(invented.decided) == 8


def test_a_faster_commit_is_found_as_well() -> None:
    (change,) = result_of(Invented({9: -0.05}), 20).changes
    assert (change.version.number, change.verdict.verdict) == (9, Verdict.FASTER)


def test_ends_that_do_not_differ_end_the_search() -> None:
    invented = Invented({})
    result = result_of(invented, 64)
    assert (result.changes, invented.decided) == ([], [(0, 64, 1)])
    assert result.ends is not None and result.ends.verdict == Verdict.SAME


def test_neighbours_are_compared_once() -> None:
    invented = Invented({1: 0.05})
    assert changed(result_of(invented, 1)) == [1]
    assert invented.decided == [(0, 1, 1)]


def test_versions_that_are_ready_are_preferred_in_the_middle_half() -> None:
    invented = Invented({21: 0.05})
    assert changed(result_of(invented, 42, ready=[2, 25, 12])) == [21]
    assert [last for _, last, _ in invented.decided[1:3]] == [25, 12]


@pytest.mark.parametrize(
    "steps", [{10: 0.06, 40: 0.06}, {10: 0.08, 40: 0.04}, {31: 0.05, 32: 0.05}, {3: 0.1, 60: -0.05}]
)
def test_two_steps_are_found_as_two(steps: dict[int, float]) -> None:
    assert changed(result_of(Invented(steps), 64)) == sorted(steps)


# verdicts that are wrong, or inconclusive


@pytest.mark.parametrize("truth", [1, 2, 31, 32, 33, 64])
@pytest.mark.parametrize("number", range(2, 8))
@pytest.mark.parametrize("wrong", [Verdict.SAME, Verdict.SLOWER])
def test_one_wrong_verdict_on_the_way_does_not_lead_astray(
    truth: int, number: int, wrong: Verdict
) -> None:
    result = result_of(Invented({truth: 0.05}, wrong={number: wrong}), 64)
    assert changed(result) == [truth]
    assert result.detail == ""


def test_a_confirmation_that_is_wrong_begins_the_search_again() -> None:
    invented = Invented({20: 0.05}, wrong={8: Verdict.SAME})
    assert changed(result_of(invented, 64)) == [20]
    assert len(invented.decided) == 15


def test_a_version_that_is_never_confirmed_is_said_to_be_likely() -> None:
    invented = Invented({20: 0.05}, wrong={8: Verdict.SAME, 15: Verdict.SAME})
    result = result_of(invented, 64)
    assert result.changes == []
    assert result.detail.startswith("likely, but not confirmed: 0000000000;")


def test_an_inconclusive_verdict_is_measured_again_with_twice_the_time() -> None:
    invented = Invented({20: 0.05}, open={(0, 32): False, (0, 64): False})
    assert changed(result_of(invented, 64)) == [20]
    assert invented.decided[:4] == [(0, 64, 1), (0, 64, 2), (0, 32, 1), (0, 32, 2)]


@pytest.mark.parametrize("truth", [20, 40])
def test_one_that_stays_inconclusive_counts_by_its_estimate(truth: int) -> None:
    invented = Invented({truth: 0.05}, open={(0, 32): True})
    assert changed(result_of(invented, 64)) == [truth]


def test_ends_that_stay_inconclusive_leave_nothing_to_search_for() -> None:
    invented = Invented({20: 0.05}, open={(0, 64): True})
    result = result_of(invented, 64)
    assert result.ends is not None and result.ends.verdict == Verdict.INCONCLUSIVE
    assert (result.changes, len(invented.decided)) == ([], 2)


def test_a_change_that_is_spread_over_many_commits_is_not_pinned_on_one() -> None:
    result = result_of(Invented(dict.fromkeys(range(1, 33), 0.002)), 32)
    assert result.changes == []
    assert result.detail.startswith("likely, but not confirmed: ")


# versions that cannot be measured


@pytest.mark.parametrize("way", ["broken", "failing"])
@pytest.mark.parametrize(
    ("numbers", "number", "skipped"),
    [([18, 19], 20, [18, 19]), ([20], 21, [20]), (range(2, 20), 20, range(2, 20)), ([5], 20, [])],
)
def test_commits_that_cannot_be_measured_are_named_with_the_change(
    way: str, numbers: Collection[int], number: int, skipped: Sequence[int]
) -> None:
    invented = Invented({20: 0.05}, **{way: numbers})
    (change,) = result_of(invented, 40).changes
    assert change.version.number == number
    assert [row.number for row in change.skipped] == [*skipped]
    assert len(invented.decided) == len({(first, last) for first, last, _ in invented.decided})


@pytest.mark.parametrize("end", [0, 40])
def test_an_end_that_cannot_be_measured_ends_the_search(end: int) -> None:
    with pytest.raises(MachineError, match="cannot build it"):
        result_of(Invented({20: 0.05}, broken=[end]), 40)
    result = result_of(Invented({20: 0.05}, failing=[end]), 40)
    assert (result.status, result.detail) == (Status.CRASHED, "signal 11")


# continued searches


def test_a_search_that_is_continued_measures_only_the_rest() -> None:
    def invented() -> Invented:
        return Invented({31: 0.05, 50: 0.08}, broken=[32], open={(0, 16): False})

    *measured, whole = search(invented(), 64)
    assert len(measured) > 12
    for count in range(len(measured) + 1):
        earlier = finished(measured[:count])
        again = invented()
        *rest, record = search(again, 64, earlier)
        assert len(rest) == len(again.decided) == len(measured) - len(earlier)
        assert isinstance(record, BisectRecord) and isinstance(whole, BisectRecord)
        assert record.changes == whole.changes
        assert record.seconds == len(measured)
        assert finished([*earlier, *rest, record]) == [*earlier, *rest, record]


def test_what_could_not_be_measured_is_tried_again() -> None:
    measured = search(Invented({20: 0.05}, broken=[20]), 40)
    failed = [each for each in measured if isinstance(each, BisectComparison) and each.detail]
    assert len(failed) == 1
    assert finished(failed) == []


# releases

VERSIONS = "3.2.7", "3.3.0", "3.3.1", "3.3.2"


@pytest.fixture
def limits_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Have the third and later releases be slow; return the time limit of each comparison."""
    limits: list[float] = []

    def decide(pool: Any, baseline: Target, candidate: Target, plan: VerdictPlan, _: Any) -> Any:
        limits.append(plan.time_limit_s)
        old, new = baseline.release.version, candidate.release.version
        record = replace(SLOWER if old < "3.3.1" <= new else SAME, old=old, new=new)
        if len(limits) == 1:
            record = replace(record, verdict=Verdict.INCONCLUSIVE)
        return record

    monkeypatch.setattr(verdict, "decide_pair", decide)
    return limits


def release_range(index_problem: str = "") -> ReleaseRange:
    return ReleaseRange([ReleaseSpec(v, v) for v in VERSIONS], index_problem)


def test_the_release_that_changed_a_model_is_searched(limits_s: list[float]) -> None:
    plan = VerdictPlan(time_limit_s=30.0)
    *_, record = bisect.search_releases(release_range(), models.resolve("cartpole"), plan)
    assert isinstance(record, BisectRecord)
    (change,) = record.changes
    assert (record.kind, record.old, record.new) == (VersionKind.RELEASE, "3.2.7", "3.3.2")
    assert (change.version.name, change.verdict.old) == ("3.3.1", "3.3.0")
    assert limits_s == [30.0, 60.0, 30.0, 30.0, 30.0]


@pytest.mark.usefixtures("limits_s")
def test_without_an_index_only_installed_releases_are_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keys = [ReleaseSpec(version, version).key for version in ("3.3.1", "3.3.2")]
    monkeypatch.setattr(installs, "install_names", lambda: keys)
    source = models.resolve("cartpole")
    *measured, record = bisect.search_releases(release_range("no network"), source, VerdictPlan())
    assert isinstance(record, BisectRecord)
    (change,) = record.changes
    assert [row.name for row in change.skipped] == ["3.3.0"]
    assert {each.detail for each in measured if isinstance(each, BisectComparison)} == {
        "",
        "not installed here, and no network",
    }


# commits


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    """Return a repository of five commits; the third is slow, and the last adds the benchmark."""
    git = new_repository(tmp_path)
    for number, speed in enumerate(("fast", "fast", "slow", "slow", "slow")):
        (tmp_path / "physics.py").write_text(f"# {number}: {speed}\n")
        if number == 4:
            (tmp_path / "bench.py").write_text("the benchmark\n")
        commit(git, f"commit {number}", f"v{number}")
    return Repository(tmp_path)


def speed(target: Any) -> str:
    return (Path(target.origin.folders[0]) / "physics.py").read_text().split()[-1]


def comparison(repository: Repository, old: str, new: str) -> RevisionComparison:
    top = repository.top.resolve()
    function = parse_function("bench.py::step", top, top)
    return RevisionComparison(
        repository, repository.parse(old), repository.parse(new), [function], top
    )


def test_the_slow_commit_is_found_with_the_last_commits_benchmark(
    repository: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts: set[bytes] = set()

    def decide(pool: Any, targets: FunctionTargets, plan: VerdictPlan) -> Any:
        texts.update(target.source.text for target in targets)
        return SLOWER if speed(targets[0]) != speed(targets[1]) else SAME

    monkeypatch.setattr(function_verdict, "decide_function", decide)
    *_, record = bisect.search_revisions(comparison(repository, "v0", "v4"), VerdictPlan())
    assert isinstance(record, BisectRecord)
    (change,) = record.changes
    assert change.version.subject == "commit 2"
    assert (record.versions, change.version.number) == (4, 2)
    assert texts == {b"the benchmark\n"}


def test_ctrl_c_ends_a_search(repository: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupted = replace(FAILED, status=Status.INTERRUPTED)
    monkeypatch.setattr(function_verdict, "decide_function", lambda *arguments: interrupted)
    with pytest.raises(KeyboardInterrupt):
        list(bisect.search_revisions(comparison(repository, "v0", "v4"), VerdictPlan()))


def test_a_candidate_before_its_baseline_is_refused(repository: Repository) -> None:
    with pytest.raises(InputError, match=r"v0 \(.*\) does not come after v4"):
        bisect.search_revisions(comparison(repository, "v4", "v0"), VerdictPlan())
