import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from mjbench.errors import MachineError
from mjbench.releases import package_index
from mjbench.releases.package_index import Upload

# Two package indexes that do not exist (RFC 2606).
INDEX, OTHER_INDEX = (f"https://{name}.invalid" for name in ("one", "two"))


def upload(time: str, yanked: bool = False) -> Upload:
    return Upload(datetime.fromisoformat(time), "mujoco.whl", yanked)


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
            "3.0.0": [Upload(datetime.now(UTC), "mujoco-3.0.0.tar.gz")],
            "3.0.2rc1": [],
            "not-a-version": [],
        }
    )
    assert files == {"3.0.0": ["mujoco-3.0.0.tar.gz"], "3.0.2rc1": []}


@pytest.mark.parametrize(
    "content",
    [b"", b"<html>", b"[]", b"null", b'{"releases": null}', b'{"releases": {"3.0": [1]}}'],
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


def test_a_file_of_which_the_index_knows_little_does_not_lose_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    time = "2024-01-01T00:00:00Z"
    complete = {"upload_time_iso_8601": time, "filename": "mujoco.whl", "yanked": False}
    wrong = {**complete, "upload_time_iso_8601": "yesterday"}
    poor = [{}, dict.fromkeys(complete), wrong, {**complete, "yanked": None, "filename": None}]
    uploads = {"3.0.0": [complete, *poor], "3.0.1": [{"filename": "other.whl"}], "3.0.2": poor[3:]}
    (tmp_path / "answer").write_text(json.dumps({"releases": uploads}))
    monkeypatch.setattr(package_index, "_index_url", (tmp_path / "answer").as_uri)
    assert [release.version for release in package_index.releases()] == ["3.0.0", "3.0.2"]
    assert package_index.files() == {"3.0.0": ["mujoco.whl"], "3.0.1": ["other.whl"], "3.0.2": []}


@pytest.mark.parametrize(
    "settings",
    ["global.index-url='{last}'", "global.index-url='{first}'\n:env:.index-url='{last}/'"],
)
def test_the_index_is_the_last_that_pip_lists(
    monkeypatch: pytest.MonkeyPatch, settings: str
) -> None:
    listed = settings.format(first=f"{OTHER_INDEX}/simple", last=f"{INDEX}/part/simple")
    monkeypatch.setattr(package_index, "_run_python", lambda *arguments: listed)
    assert package_index._index_url() == f"{INDEX}/part/pypi/mujoco/json"


def test_credentials_of_the_address_become_a_header() -> None:
    request = package_index._request("https://name:secret@index.invalid/pypi/mujoco/json")
    assert request.full_url == "https://index.invalid/pypi/mujoco/json"
    assert request.get_header("Authorization") == "Basic bmFtZTpzZWNyZXQ="
