from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.releases import bundle, catalogue, install_check, package_index
from mjbench.releases.release import Release, version_key
from mjbench.releases.release_names import ReleaseSpec

START = datetime(2024, 1, 1, tzinfo=UTC)
RELEASES = [Release(f"3.0.{n}", START + timedelta(days=n)) for n in range(3)]


@pytest.fixture
def history(tmp_path: Path) -> Path:
    path = tmp_path / "history.bundle"
    bundle.write(path, RELEASES[:2])
    return path


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install_check, "installed_version", lambda: "3.0.1")


def test_a_release_is_listed_once_with_all_places_that_have_it(
    history: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package_index, "releases", lambda: RELEASES[1:])
    known = catalogue.list_releases(history)
    assert known.problem == ""
    assert [(r.version, r.in_history, r.in_index, r.installed) for r in known.releases] == [
        ("3.0.0", True, False, False),
        ("3.0.1", True, True, True),
        ("3.0.2", False, True, False),
    ]
    assert known.releases[0].uploaded == "2024-01-01T00:00:00+00:00"


def test_without_an_index_the_history_is_listed(
    history: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreachable() -> list[Release]:
        raise MachineError("no network")

    monkeypatch.setattr(package_index, "releases", unreachable)
    known = catalogue.list_releases(history)
    assert known.problem == "no network"
    assert [(r.version, r.in_index) for r in known.releases] == [("3.0.0", None), ("3.0.1", None)]


def test_an_installed_release_that_is_nowhere_else_comes_last(
    history: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package_index, "releases", lambda: RELEASES)
    monkeypatch.setattr(install_check, "installed_version", lambda: "3.0.1+g1a2b3c")
    last = catalogue.list_releases(history).releases[-1]
    assert last == catalogue.ReleaseRow(
        version="3.0.1+g1a2b3c",
        uploaded=None,
        tag="v3.0.1+g1a2b3c",
        in_history=False,
        in_index=False,
        installed=True,
    )


def test_versions_sort_by_their_first_three_numbers() -> None:
    versions = ["3.10.0", "3.2.0", "3.2.0.post1", "2.3.7"]
    assert sorted(versions, key=version_key) == ["2.3.7", "3.2.0", "3.2.0.post1", "3.10.0"]


def spec(version: str) -> ReleaseSpec:
    return ReleaseSpec(version, version)


def test_a_range_has_both_ends_and_the_releases_between_them(
    history: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package_index, "releases", lambda: RELEASES)
    ends = spec("2.3.7"), spec("3.0.1+local")
    releases = catalogue.releases_between(*ends, history)
    assert [each.version for each in releases.specs] == ["2.3.7", "3.0.0", "3.0.1+local"]
    assert releases.notes == []


@pytest.mark.parametrize("candidate", ["2.3.7", "3.0.0"])
def test_a_range_ends_with_a_newer_release(history: Path, candidate: str) -> None:
    with pytest.raises(InputError, match=r"does not come after 3\.0\.0"):
        catalogue.releases_between(spec("3.0.0"), spec(candidate), history)
