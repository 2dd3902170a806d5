"""The files that names and folders stand for."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from mjbench.commands.lint.script_files import UncheckedFile, regular_files, script_files


def create(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def below(folder: Path) -> list[str]:
    files = script_files([str(folder)])
    assert not any(isinstance(file, UncheckedFile) for file in files)
    return [str(Path(str(file)).relative_to(folder)) for file in files]


def test_names_stay_in_their_order_and_folders_become_their_files(tmp_path: Path) -> None:
    create(tmp_path, "b.py", "sub/a.py", "sub/run.ipynb", "notes.txt", "c.pyc")
    named = [str(tmp_path / "notes.txt"), str(tmp_path / "missing.py")]
    files = [str(tmp_path / name) for name in ("b.py", "sub/a.py")]
    assert script_files([named[0], str(tmp_path), named[1]]) == [named[0], *files, named[1]]


def test_names_below_the_current_folder_are_short(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create(tmp_path, "a.py")
    monkeypatch.chdir(tmp_path)
    assert script_files(["."]) == ["a.py"]


def test_a_folder_is_searched_whatever_its_name_but_for_checkpoints(tmp_path: Path) -> None:
    create(tmp_path, "folder.py/a.py", ".ipynb_checkpoints/b.ipynb", "c/.ipynb_checkpoints/d.py")
    assert below(tmp_path) == ["folder.py/a.py"]


def test_links_to_folders_are_not_followed(tmp_path: Path) -> None:
    create(tmp_path, "sub/a.py")
    (tmp_path / "sub/again").symlink_to(tmp_path)
    (tmp_path / "loop.py").symlink_to("loop.py")
    assert below(tmp_path) == ["loop.py", "sub/a.py"]
    (tmp_path / "link").symlink_to("sub")
    assert below(tmp_path / "link") == ["a.py"]


def test_a_folder_without_python_is_said(tmp_path: Path) -> None:
    create(tmp_path, "notes.txt")
    folder = str(tmp_path)
    assert script_files([folder]) == [UncheckedFile(folder, "no Python file in this folder")]


def test_a_folder_that_cannot_be_listed_is_said_in_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create(tmp_path, "a.py", "locked/b.py", "z.py")
    scandir = os.scandir

    def refuse(folder: str) -> Iterator[os.DirEntry[str]]:
        if folder.endswith("locked"):
            raise PermissionError(13, "Permission denied", folder)
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", refuse)
    locked = str(tmp_path / "locked")
    unchecked = UncheckedFile(locked, "cannot be listed: Permission denied")
    assert script_files([locked]) == [unchecked]
    files = [str(tmp_path / "a.py"), unchecked, str(tmp_path / "z.py")]
    assert script_files([str(tmp_path)]) == files


def test_only_what_can_be_read_is_a_regular_file(tmp_path: Path) -> None:
    create(tmp_path, "a.py")
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "loop.py").symlink_to("loop.py")
    names = [str(tmp_path / name) for name in ("a.py", "pipe.py", "loop.py", "missing.py")]
    others = [str(tmp_path), "x" * 5000, "", UncheckedFile("b.py", "")]
    assert regular_files([*names, *others]) == [tmp_path / "a.py"]
