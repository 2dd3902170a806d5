"""The history of releases, and the guard that the MuJoCo in a process is the one meant."""

import json
import os
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco
import pytest
from commands import mjbench

from mjbench.errors import InputError
from mjbench.releases import catalogue, install_check
from mjbench.releases.catalogue import Release

START = datetime(2024, 1, 1, tzinfo=UTC)
THREE = [Release(v, START + timedelta(days=n)) for n, v in enumerate(("3.0.0", "3.0.1", "2.3.8"))]


# An index that refuses the connection at once, wherever the tests run.
OFFLINE = {"PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": "http://127.0.0.1:9/simple"}


# the history


def test_a_history_is_read_as_it_was_written_in_upload_order(tmp_path: Path) -> None:
    bundle = tmp_path / "history.bundle"
    catalogue.write(bundle, THREE)
    assert catalogue.read(bundle) == THREE
    assert sorted(catalogue.hashes(bundle)) == ["releases", "v2.3.8", "v3.0.0", "v3.0.1"]


def test_hashes_follow_from_the_releases_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    catalogue.write(tmp_path / "one", THREE)
    monkeypatch.setenv("GIT_AUTHOR_NAME", "somebody else")
    monkeypatch.setenv("GIT_COMMITTER_DATE", "2001-01-01T00:00:00Z")
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    catalogue.write(tmp_path / "two", THREE)
    assert catalogue.hashes(tmp_path / "one") == catalogue.hashes(tmp_path / "two")


def test_appending_keeps_every_earlier_hash(tmp_path: Path) -> None:
    bundle = tmp_path / "history.bundle"
    catalogue.write(bundle, THREE[:2])
    before = catalogue.hashes(bundle)
    assert catalogue.update(bundle, THREE) == THREE[2:]
    after = catalogue.hashes(bundle)
    assert {name: after[name] for name in ("v3.0.0", "v3.0.1")} == {
        name: before[name] for name in ("v3.0.0", "v3.0.1")
    }
    assert catalogue.update(bundle, THREE) == []


def test_a_release_cannot_be_inserted(tmp_path: Path) -> None:
    bundle = tmp_path / "history.bundle"
    catalogue.write(bundle, THREE[1:])
    with pytest.raises(InputError, match=r"3\.0\.0 came before 2\.3\.8"):
        catalogue.update(bundle, THREE)
    assert catalogue.read(bundle) == THREE[1:]


def test_verify_finds_another_upload_time_and_a_release_that_does_not_exist(
    tmp_path: Path,
) -> None:
    bundle = tmp_path / "history.bundle"
    catalogue.write(bundle, THREE)
    assert catalogue.verify(bundle, THREE) == []
    moved = [Release("3.0.0", START + timedelta(hours=1)), THREE[1]]
    first, second = catalogue.verify(bundle, moved)
    assert "v3.0.0: uploaded 2024-01-01 00:00:00, the index says 2024-01-01 01:00:00" in first
    assert "v2.3.8" in second
    assert "no such release" in second


def test_verify_finds_a_history_made_otherwise(tmp_path: Path) -> None:
    """Its releases are right, but a commit names another maker: every later hash differs."""
    bundle, clone = tmp_path / "history.bundle", tmp_path / "clone"
    catalogue.write(bundle, THREE)

    def git(*words: str) -> None:
        subprocess.run(["git", *words], cwd=clone if clone.exists() else None, check=True)

    git("clone", "--quiet", "--branch", "releases", str(bundle), str(clone))
    who = ["-c", "user.name=x", "-c", "user.email=x@y"]
    git(*who, "commit", "--quiet", "--amend", "--no-edit", "--reset-author")
    git("tag", "--force", "v2.3.8")
    git("bundle", "create", "--quiet", str(bundle), "HEAD", "releases", "--tags")
    problems = catalogue.verify(bundle)
    assert [p.partition(":")[0] for p in problems] == ["releases", "v2.3.8"]


@pytest.mark.parametrize("content", [b"", b"no bundle", b"# v2 git bundle\n"])
def test_a_broken_bundle_is_told_in_a_line(tmp_path: Path, content: bytes) -> None:
    bundle = tmp_path / "history.bundle"
    bundle.write_bytes(content)
    for command in ("list", "verify"):
        done = mjbench("releases", command, "--history", str(bundle), env=OFFLINE)
        assert done.returncode in (2, 3)
        assert done.stderr.startswith("mjbench: ")
        assert len(done.stderr.splitlines()) == 1


def test_the_committed_history_is_whole_and_begins_before_the_first_supported_release() -> None:
    bundle = catalogue.bundle_path()
    assert catalogue.verify(bundle) == []
    versions = [r.version for r in catalogue.read(bundle)]
    assert versions[:2] == ["2.3.6", "2.3.7"]
    assert "4.0.0" in versions


# the index


def upload(time: str, **more: Any) -> dict[str, Any]:
    return {"upload_time_iso_8601": time, **more}


def test_releases_are_those_final_and_not_yanked_in_upload_order() -> None:
    found = catalogue._released(
        {
            "3.0.1": [upload("2024-02-01T10:00:01.5Z"), upload("2024-02-01T09:59:59.25Z")],
            "3.0.0": [upload("2024-01-01T00:00:00Z")],
            "3.0.2rc1": [upload("2024-03-01T00:00:00Z")],
            "3.0.3": [upload("2024-03-02T00:00:00Z", yanked=True)],
            "3.0.4": [],
            "2.0.0": [upload("2024-03-03T00:00:00Z")],
        }
    )
    assert [r.version for r in found] == ["3.0.0", "3.0.1"]
    assert found[1].uploaded == datetime(2024, 2, 1, 9, 59, 59, tzinfo=UTC)


def test_without_network_the_list_shows_what_is_here_and_says_so(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    done = mjbench("releases", "list", "--json", str(out), env=OFFLINE)
    assert done.returncode == 0
    assert len(done.stderr.splitlines()) == 1
    assert "package index" in done.stderr
    rows = {row["version"]: row for row in json.loads(out.read_text())["releases"]}
    assert rows["2.3.7"]["in_history"]
    assert rows["2.3.7"]["in_index"] is None
    assert [v for v, row in rows.items() if row["installed"]] == [metadata.version("mujoco")]


def test_without_network_nothing_is_updated(tmp_path: Path) -> None:
    bundle = tmp_path / "history.bundle"
    catalogue.write(bundle, THREE)
    before = bundle.read_bytes()
    done = mjbench("releases", "update", "--history", str(bundle), env=OFFLINE)
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert bundle.read_bytes() == before


def test_without_network_the_hashes_are_verified() -> None:
    done = mjbench("releases", "verify", env=OFFLINE)
    assert done.returncode == 0
    assert "every hash" in done.stdout
    assert "Upload times were not checked" in done.stderr


def test_without_git_the_history_is_told_unreadable_in_a_line() -> None:
    done = mjbench("releases", "verify", env=OFFLINE | {"PATH": os.devnull})
    assert done.returncode == 3
    assert "git is not installed" in done.stderr


# the guard


def test_the_release_installed_here_is_whole() -> None:
    assert install_check.imported_problem() is None
    assert install_check.imported_problem(metadata.version("mujoco")) is None


def test_another_release_than_the_one_meant_is_refused() -> None:
    assert "MuJoCo 2.3.7 is meant" in (install_check.imported_problem("2.3.7") or "")


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        ("__version__", "2.0.0", "the package is 2.0.0"),
        ("mj_versionString", lambda: "2.0.0", "the C library is 2.0.0"),
        ("__path__", [*mujoco.__path__, "/elsewhere/mujoco"], "is mixed from"),
    ],
)
def test_a_mixed_release_is_refused(
    monkeypatch: pytest.MonkeyPatch, attribute: str, value: Any, said: str
) -> None:
    monkeypatch.setattr(mujoco, attribute, value)
    assert said in (install_check.imported_problem() or "")


def test_a_distribution_left_by_another_release_is_refused(monkeypatch: Any) -> None:
    class Left:
        metadata = {"Name": "mujoco-core"}  # noqa: RUF012
        version = "4.1.0"

    monkeypatch.setattr(install_check, "_distributions", lambda: [Left()])
    assert "distribution mujoco-core is 4.1.0" in (install_check.imported_problem() or "")


def test_a_module_from_elsewhere_is_refused(monkeypatch: Any, tmp_path: Path) -> None:
    stray = type(sys)("mujoco.stray")
    stray.__file__ = str(tmp_path / "stray.py")
    monkeypatch.setitem(sys.modules, "mujoco.stray", stray)
    assert "module mujoco.stray was loaded from" in (install_check.imported_problem() or "")


@pytest.mark.parametrize(
    ("change", "said"), [(os.remove, "is missing"), (lambda p: p.write_text("x"), "been changed")]
)
def test_a_broken_file_is_refused(tmp_path: Path, change: Any, said: str) -> None:
    """A whole distribution made by hand, and one of its files lost or rewritten."""
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "part.py").write_text("part = 1\n")
    info = tmp_path / "mujoco-9.9.9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mujoco\nVersion: 9.9.9\n")
    (info / "RECORD").write_text("mujoco/part.py,sha256=x,9\nmujoco-9.9.9.dist-info/RECORD,,\n")
    (made,) = metadata.distributions(name="mujoco", path=[str(tmp_path)])
    assert install_check._broken_file([made]) is None
    change(tmp_path / "mujoco" / "part.py")
    assert said in (install_check._broken_file([made]) or "")
