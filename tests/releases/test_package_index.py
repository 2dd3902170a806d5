from datetime import UTC, datetime
from pathlib import Path

import pytest

from mjbench.errors import MachineError
from mjbench.releases import package_index
from mjbench.releases.package_index import Upload


def upload(time: str, yanked: bool = False) -> Upload:
    return {"upload_time_iso_8601": time, "yanked": yanked}


def test_releases_are_the_final_ones_that_were_not_yanked_in_upload_order() -> None:
    releases = package_index._final_releases(
        {
            "3.0.1": [upload("2024-02-01T10:00:01.5Z"), upload("2024-02-01T09:59:59.25Z")],
            "3.0.0": [upload("2024-01-01T00:00:00Z")],
            "3.0.1.post1": [upload("2024-02-02T00:00:00Z")],
            "3.0.2rc1": [upload("2024-03-01T00:00:00Z")],
            "3.0.2.dev3": [upload("2024-03-01T00:00:00Z")],
            "not-a-version": [upload("2024-03-01T00:00:00Z")],
            "3.0.3": [upload("2024-03-02T00:00:00Z", yanked=True)],
            "3.0.4": [],
            "2.0.0": [upload("2024-03-03T00:00:00Z")],
        }
    )
    assert [r.version for r in releases] == ["3.0.0", "3.0.1", "3.0.1.post1"]
    assert releases[1].uploaded == datetime(2024, 2, 1, 9, 59, 59, tzinfo=UTC)


def test_the_names_of_all_files_are_known_by_version() -> None:
    files = package_index._files(
        {
            "3.0.0": [upload("2024-01-01T00:00:00Z") | {"filename": "mujoco-3.0.0.tar.gz"}],
            "3.0.2rc1": [],
            "not-a-version": [],
        }
    )
    assert files == {"3.0.0": ["mujoco-3.0.0.tar.gz"], "3.0.2rc1": []}


@pytest.mark.parametrize(
    "content",
    [b"", b"<html>", b"[]", b"null", b'{"releases": null}', b'{"releases": {"3.0": [{}]}}'],
)
def test_an_answer_that_is_not_the_indexs_is_a_machine_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "answer").write_bytes(content)
    monkeypatch.setattr(package_index, "_index_url", (tmp_path / "answer").as_uri)
    for read in (package_index.releases, package_index.files):
        with pytest.raises(
            MachineError, match="cannot read the releases of mujoco from the package"
        ):
            read()


@pytest.mark.parametrize(
    ("settings", "url"),
    [
        ("global.index-url='https://one.invalid/simple'", "https://one.invalid/pypi/mujoco/json"),
        (
            "global.index-url='https://one.invalid/simple'\n"
            ":env:.index-url='https://two.invalid/root/simple/'",
            "https://two.invalid/root/pypi/mujoco/json",
        ),
    ],
)
def test_the_index_is_the_last_that_pip_lists(
    monkeypatch: pytest.MonkeyPatch, settings: str, url: str
) -> None:
    monkeypatch.setattr(package_index, "_run_python", lambda *arguments: settings)
    assert package_index._index_url() == url


def test_credentials_of_the_address_become_a_header() -> None:
    request = package_index._request("https://name:secret@index.invalid/pypi/mujoco/json")
    assert request.full_url == "https://index.invalid/pypi/mujoco/json"
    assert request.get_header("Authorization") == "Basic bmFtZTpzZWNyZXQ="
