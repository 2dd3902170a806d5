"""Where the npm package lies, and which error there is where it is missing."""

import json
import re
from pathlib import Path

import pretending_node
import pytest

from mjbench.errors import InputError, MachineError
from mjbench.web import npm_package
from mjbench.web.npm_package import Build


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "the cache"
    monkeypatch.setenv("MJBENCH_CACHE", str(folder))
    return folder


def test_the_pin_is_one_exact_version() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", npm_package.pinned_version())
    content = json.loads(Path(npm_package.__file__).with_name("package.json").read_text())
    assert content["private"] is True
    assert not list(Path(npm_package.__file__).parent.glob("*lock*"))


def test_a_missing_package_is_one_line_with_the_command_of_npm(cache: Path) -> None:
    with pytest.raises(MachineError) as caught:
        npm_package.find("3.12.0")
    assert str(caught.value) == (
        "@mujoco/mujoco 3.12.0 is not installed: npm install --no-package-lock"
        f" --prefix '{cache}/npm/3.12.0' @mujoco/mujoco@3.12.0"
    )


def test_it_is_found_where_that_command_puts_it(cache: Path) -> None:
    for version in ("3.9.0", "3.10.0"):
        pretending_node.package(cache / "npm" / version, version)
    package = npm_package.find("3.10.0")
    assert package.version == "3.10.0"
    assert package.script(Build.WASM_MT) == package.folder / "mt/mujoco.js"
    assert npm_package.installed_versions() == ["3.9.0", "3.10.0"]
    with pytest.raises(MachineError, match=r"installed: 3\.9\.0, 3\.10\.0"):
        npm_package.find("3.12.0")


@pytest.mark.parametrize("below", ["", "node_modules", "node_modules/@mujoco/mujoco"])
def test_a_folder_of_the_users_may_be_the_project_or_the_package(
    tmp_path: Path, below: str
) -> None:
    project = pretending_node.package(tmp_path / "app", "3.13.0")
    assert npm_package.find(folder=project / below).version == "3.13.0"
    with pytest.raises(InputError, match=r"has @mujoco/mujoco 3\.13\.0, not 3\.14\.0"):
        npm_package.find("3.14.0", project / below)


def test_a_folder_without_the_package_is_refused(tmp_path: Path) -> None:
    (tmp_path / "package.json").write_text('{"name": "other", "version": "1.0.0"}')
    with pytest.raises(InputError, match="has no package @mujoco/mujoco: npm install"):
        npm_package.find(folder=tmp_path)


def test_a_package_that_is_not_whole_is_refused(tmp_path: Path) -> None:
    project = pretending_node.package(tmp_path / "app", "3.13.0")
    wasm = project / "node_modules/@mujoco/mujoco/mt/mujoco.wasm"
    wasm.write_bytes(b"")
    with pytest.raises(MachineError, match="is missing or empty; remove"):
        npm_package.find(folder=project)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "cannot read"),
        ("[]", "not the manifest"),
        ('{"name": "@mujoco/mujoco"}', "no version"),
    ],
)
def test_a_damaged_manifest_is_refused(tmp_path: Path, content: str, message: str) -> None:
    project = pretending_node.package(tmp_path / "app", "3.13.0")
    (project / "node_modules/@mujoco/mujoco/package.json").write_text(content)
    with pytest.raises(MachineError, match=message):
        npm_package.find(folder=project)


def test_a_cache_that_holds_another_release_is_refused(cache: Path) -> None:
    pretending_node.package(cache / "npm/3.14.0", "3.13.0")
    with pytest.raises(MachineError, match=r"has @mujoco/mujoco 3\.13\.0, not 3\.14\.0"):
        npm_package.find("3.14.0")
