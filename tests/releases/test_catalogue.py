from datetime import UTC, datetime, timedelta

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.releases import catalogue, install_check, installs, package_index
from mjbench.releases.release import Release, version_key
from mjbench.releases.release_names import ReleaseSpec

START = datetime(2024, 1, 1, tzinfo=UTC)
RELEASES = [Release(f"3.0.{n}", START + timedelta(days=n)) for n in range(3)]


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have 3.0.1 installed, and 3.0.0 and a build of 3.0.2 in the cache."""
    monkeypatch.setattr(install_check, "installed_version", lambda: "3.0.1")
    names = ["3.0.0-cpython-311-x86_64", "3.0.2+abc-cpython-311-x86_64"]
    monkeypatch.setattr(installs, "install_names", lambda: names)


def unreachable() -> list[Release]:
    raise MachineError("no network")


def test_a_release_is_listed_once_with_all_places_that_have_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(package_index, "releases", lambda: RELEASES[1:])
    known = catalogue.list_releases()
    assert known.problem == ""
    assert [(r.version, r.in_index, r.in_cache, r.installed) for r in known.releases] == [
        ("3.0.1", True, False, True),
        ("3.0.2", True, False, False),
        ("3.0.0", False, True, False),
        ("3.0.2+abc", False, True, False),
    ]
    assert known.releases[0].uploaded == "2024-01-02T00:00:00+00:00"


def test_without_an_index_what_is_here_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(package_index, "releases", unreachable)
    known = catalogue.list_releases()
    assert known.problem == "no network"
    versions = ["3.0.0", "3.0.1", "3.0.2+abc"]
    assert [(r.version, r.in_index) for r in known.releases] == [(v, None) for v in versions]


def test_without_an_index_a_range_has_the_releases_in_the_cache(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(package_index, "releases", unreachable)
    releases = catalogue.releases_between(spec("2.3.7"), spec("3.1.0"))
    assert [each.version for each in releases.specs] == ["2.3.7", "3.0.0", "3.0.1", "3.1.0"]
    assert releases.notes == ["only releases that are installed here take part: no network"]


def test_versions_sort_by_their_first_three_numbers() -> None:
    versions = ["3.10.0", "3.2.0", "3.2.0.post1", "2.3.7"]
    assert sorted(versions, key=version_key) == ["2.3.7", "3.2.0", "3.2.0.post1", "3.10.0"]


def spec(version: str) -> ReleaseSpec:
    return ReleaseSpec(version, version)


def test_a_range_has_both_ends_and_the_releases_between_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(package_index, "releases", lambda: RELEASES)
    ends = spec("2.3.7"), spec("3.0.1+local")
    releases = catalogue.releases_between(*ends)
    assert [each.version for each in releases.specs] == ["2.3.7", "3.0.0", "3.0.1+local"]
    assert releases.notes == []


@pytest.mark.parametrize("candidate", ["2.3.7", "3.0.0"])
def test_a_range_ends_with_a_newer_release(candidate: str) -> None:
    with pytest.raises(InputError, match=r"does not come after 3\.0\.0"):
        catalogue.releases_between(spec("3.0.0"), spec(candidate))
