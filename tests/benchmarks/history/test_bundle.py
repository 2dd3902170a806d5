import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from benchmarks.history import bundle
from mjbench.errors import InputError
from mjbench.releases.release import Release

START = datetime(2024, 1, 1, tzinfo=UTC)
THREE = [Release(v, START + timedelta(days=n)) for n, v in enumerate(("3.0.0", "3.0.1", "2.3.8"))]


def test_a_history_is_read_as_it_was_written_in_upload_order(tmp_path: Path) -> None:
    path = tmp_path / "history.bundle"
    bundle.write(path, THREE)
    assert bundle.read(path) == THREE
    assert sorted(bundle.hashes(path)) == ["releases", "v2.3.8", "v3.0.0", "v3.0.1"]


def test_hashes_follow_from_the_releases_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle.write(tmp_path / "one", THREE)
    monkeypatch.setenv("GIT_AUTHOR_NAME", "somebody else")
    monkeypatch.setenv("GIT_COMMITTER_DATE", "2001-01-01T00:00:00Z")
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    bundle.write(tmp_path / "two", THREE)
    assert bundle.hashes(tmp_path / "one") == bundle.hashes(tmp_path / "two")


def test_appending_keeps_every_earlier_hash(tmp_path: Path) -> None:
    path = tmp_path / "history.bundle"
    bundle.write(path, THREE[:2])
    before = bundle.hashes(path)
    assert bundle.update(path, THREE) == THREE[2:]
    after = bundle.hashes(path)
    assert {name: after[name] for name in ("v3.0.0", "v3.0.1")} == {
        name: before[name] for name in ("v3.0.0", "v3.0.1")
    }
    assert bundle.update(path, THREE) == []


def test_a_release_cannot_be_inserted(tmp_path: Path) -> None:
    path = tmp_path / "history.bundle"
    bundle.write(path, THREE[1:])
    with pytest.raises(InputError, match=r"3\.0\.0 came before 2\.3\.8"):
        bundle.update(path, THREE)
    assert bundle.read(path) == THREE[1:]


def test_verify_finds_another_upload_time_and_a_release_that_does_not_exist(tmp_path: Path) -> None:
    path = tmp_path / "history.bundle"
    bundle.write(path, THREE)
    assert bundle.verify(path, THREE) == []
    moved = [Release("3.0.0", START + timedelta(hours=1)), THREE[1]]
    first, second = bundle.verify(path, moved)
    assert "v3.0.0: uploaded 2024-01-01 00:00:00, the index says 2024-01-01 01:00:00" in first
    assert "v2.3.8" in second
    assert "no such release" in second


def test_verify_finds_a_changed_commit(tmp_path: Path) -> None:
    """The releases are right, but a commit has another author: every later hash differs."""
    path, clone = tmp_path / "history.bundle", tmp_path / "clone"
    bundle.write(path, THREE)

    def git(*arguments: str) -> None:
        subprocess.run(["git", *arguments], cwd=clone if clone.exists() else None, check=True)

    git("clone", "--quiet", "--branch", "releases", str(path), str(clone))
    author = ["-c", "user.name=x", "-c", "user.email=x@y"]
    git(*author, "commit", "--quiet", "--amend", "--no-edit", "--reset-author")
    git("tag", "--force", "v2.3.8")
    git("bundle", "create", "--quiet", str(path), "HEAD", "releases", "--tags")
    problems = bundle.verify(path)
    assert [p.partition(":")[0] for p in problems] == ["releases", "v2.3.8"]


def test_the_committed_history_is_intact_and_begins_before_the_first_supported_release() -> None:
    path = bundle.default_path()
    assert bundle.verify(path) == []
    versions = [r.version for r in bundle.read(path)]
    assert versions[:2] == ["2.3.6", "2.3.7"]
    assert "4.0.0" in versions
