"""Searches in a repository: which pairs of commits are compared, by which benchmark."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from git_checkout import commit, new_repository
from verdict_records import SAME, SLOWER, launch

from mjbench.errors import InputError
from mjbench.paired import function_verdict, revision_bisect
from mjbench.paired.function_sides import FunctionTargets, RevisionComparison, parse_function
from mjbench.paired.verdict import VerdictPlan
from mjbench.releases.revisions import Repository


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
    texts: set[bytes | None] = set()

    def is_slower(targets: FunctionTargets) -> bool:
        texts.update(target.source.text for target in targets)
        return speed(targets[0]) != speed(targets[1])

    def decide(pool: Any, targets: FunctionTargets, plan: VerdictPlan) -> Any:
        return replace(SLOWER if is_slower(targets) else SAME, samples=[launch(0.03)] * 3)

    def log_ratios(pool: Any, targets: FunctionTargets, count: int) -> list[float]:
        return [0.03 if is_slower(targets) else 0.0] * count

    monkeypatch.setattr(function_verdict, "decide", decide)
    monkeypatch.setattr(function_verdict, "launch_log_ratios", log_ratios)
    *_, record = revision_bisect.search(comparison(repository, "v0", "v4"), VerdictPlan())
    (change,) = record.changes
    assert change.version.subject == "commit 2"
    assert (record.versions, change.version.number) == (4, 2)
    assert texts == {b"the benchmark\n"}


def test_a_candidate_before_its_baseline_is_refused(repository: Repository) -> None:
    with pytest.raises(InputError, match=r"v0 \(.*\) does not come after v4"):
        revision_bisect.search(comparison(repository, "v4", "v0"), VerdictPlan())
