"""Installs whose libraries are moved: what they hold, and that the original stays as it was."""

import csv
import ctypes
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moved_bytes import moved

from mjbench.paired import release_python
from mjbench.releases import install_check, moved_install
from mjbench.releases.moved_install import MovableImage, MovableInstall, file_version
from mjbench.releases.placement import Placement

PLACEMENT = Placement(engine_bytes=16, extension_bytes=32)
NOWHERE: Any = np.empty((0, 2), np.int64)
IMAGE = MovableImage(8, np.array([8]), NOWHERE, NOWHERE)


@pytest.fixture
def install(tmp_path: Path) -> MovableInstall:
    """Return an install made by hand: two libraries that move, one that does not, a module."""
    site = tmp_path / "site"
    (site / "mujoco" / "part").mkdir(parents=True)
    (site / "other").mkdir()
    names = ["libmujoco.so.9.9.9", "_functions.cpython.so", "_enums.cpython.so", "part/a.py"]
    for name in names:
        (site / "mujoco" / name).write_bytes(bytes(32))
    (site / "mujoco" / "__init__.py").write_text("__version__ = '9.9.9'\n")
    rows = [[f"mujoco/{name}", "sha256=abc", "32"] for name in names]
    rows += [["mujoco/__init__.py", "sha256=abc", "22"], ["mujoco-9.9.9.dist-info/RECORD", "", ""]]
    for name in ("mujoco-9.9.9.dist-info", "mujoco_core-9.9.9.dist-info", "mujoco_mjx-9.dist-info"):
        (site / name).mkdir()
        (site / name / "RECORD").write_text("".join(",".join(row) + "\n" for row in rows))
    versions = {name: file_version(site / "mujoco" / name) for name in names[:2]}
    return MovableInstall(site, dict.fromkeys(names[:2], IMAGE), versions, "digest")


def test_libraries_are_moved_and_everything_else_is_linked(
    install: MovableInstall, tmp_path: Path
) -> None:
    install.create(tmp_path / "moved", PLACEMENT)
    package = tmp_path / "moved" / "mujoco"
    assert (package / "libmujoco.so.9.9.9").stat().st_size == 32 + 16
    assert (package / "_functions.cpython.so").stat().st_size == 32 + 32
    for name in ("_enums.cpython.so", "__init__.py", "part"):
        assert (package / name).samefile(install.site / "mujoco" / name)
    assert {p.name for p in package.iterdir()} == {
        p.name for p in (install.site / "mujoco").iterdir()
    }
    assert all(len(p.read_bytes()) == 32 for p in (install.site / "mujoco").glob("*.so*"))


def test_the_record_has_the_sizes_of_moved_libraries(
    install: MovableInstall, tmp_path: Path
) -> None:
    install.create(tmp_path / "moved", PLACEMENT)
    for name in ("mujoco-9.9.9.dist-info", "mujoco_core-9.9.9.dist-info"):
        record = (tmp_path / "moved" / name / "RECORD").read_text()
        rows = {row[0]: row[1:] for row in csv.reader(record.splitlines())}
        assert rows["mujoco/libmujoco.so.9.9.9"] == ["", "48"]
        assert rows["mujoco/_functions.cpython.so"] == ["", "64"]
        assert rows["mujoco/_enums.cpython.so"] == ["sha256=abc", "32"]
        original = (install.site / name / "RECORD").read_text()
        assert "mujoco/libmujoco.so.9.9.9,sha256=abc,32" in original


def test_files_are_copied_where_they_cannot_be_linked(
    install: MovableInstall, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    monkeypatch.setattr(os, "link", refuse)
    install.create(tmp_path / "moved", PLACEMENT)
    copy, original = (
        folder / "mujoco" / "_enums.cpython.so" for folder in (tmp_path / "moved", install.site)
    )
    assert copy.read_bytes() == original.read_bytes()
    assert not copy.samefile(original)
    assert copy.stat().st_mtime == original.stat().st_mtime  # compiled Python stays valid


def test_a_process_imports_the_moved_package_and_all_others_of_its_folder(
    install: MovableInstall, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", ["elsewhere", str(install.site), f"{install.site}/../site"])
    moved, others = tmp_path / "moved", tmp_path / "others"
    install.link_others(others)
    assert install.use(moved, others, PLACEMENT) == moved / "mujoco"
    assert sys.path == ["elsewhere", str(moved), str(others)]
    assert {p.name for p in others.iterdir()} == {"other", "mujoco_mjx-9.dist-info"}
    assert (others / "other").samefile(install.site / "other")


@pytest.mark.parametrize(
    ("name", "moves"),
    [
        ("libmujoco.so.3.3.0", True),
        ("_functions.cpython-311-x86_64-linux-gnu.so", True),
        ("_batch.cpython-311-x86_64-linux-gnu.so", True),
        ("_render.cpython-311-x86_64-linux-gnu.so", False),
        ("libmujoco_studio.so", False),
        ("_functions.pyi", False),
    ],
)
def test_what_a_step_runs_through_is_moved(name: str, moves: bool) -> None:
    assert moved_install.moves(name) == moves


@pytest.mark.parametrize("name", ["mujoco_core-9.9.9.dist-info", "mujoco-9.9.9.dist-info"])
def test_a_distribution_without_a_record_is_noticed(install: MovableInstall, name: str) -> None:
    assert moved_install.is_recorded(install.site)
    (install.site / name / "RECORD").unlink()
    assert not moved_install.is_recorded(install.site)


# The MuJoCo installed here, moved, in a process of its own.

PROGRAM = """
import ctypes, json, pickle, sys
from pathlib import Path
file, folder = map(Path, sys.argv[1:])
movable, placement = pickle.loads(file.read_bytes())
folder.mkdir()
movable.link_others(folder / "others")
movable.use(folder / "moved", folder / "others", placement)
import mujoco
from mjbench.releases import install_check
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
mujoco.mj_step(model, mujoco.MjData(model))
def address(library, name):
    return ctypes.cast(getattr(ctypes.PyDLL(library), name), ctypes.c_void_p).value
package = Path(mujoco.__file__).parent
(engine,) = map(str, package.glob("libmujoco.so*"))
print(json.dumps({
    "problem": install_check.imported_problem(),
    "version": mujoco.mj_versionString(),
    "package": str(package),
    "mj_step": address(engine, "mj_step"),
    "extension": address(mujoco._functions.__file__, "PyInit__functions"),
}))
"""


def address_modulo_page(library: Path, name: str) -> int:
    """Return where a symbol of a library lies within its page, as it was built."""
    address = ctypes.cast(getattr(ctypes.PyDLL(str(library)), name), ctypes.c_void_p).value
    assert address is not None
    return address % 4096


@pytest.mark.parametrize("placement", [Placement(16, 4080), Placement(4064, 48)])
def test_the_installed_release_runs_moved_and_stays_as_it_was(
    movable_install: MovableInstall, tmp_path: Path, placement: Placement
) -> None:
    package = movable_install.site / "mujoco"
    before = {f: (f.stat().st_size, f.stat().st_mtime_ns) for f in package.iterdir() if f.is_file()}
    (tmp_path / "core").mkdir()
    release_python.link_mjbench(tmp_path / "core")
    file = tmp_path / "movable.pickle"
    file.write_bytes(pickle.dumps((movable_install, placement)))
    done = subprocess.run(
        [
            *release_python.command(PROGRAM, tmp_path / "core", None),
            *(str(file), str(tmp_path / "new")),
        ],
        cwd=tmp_path,
        env=release_python.environment(None),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["problem"] is None
    assert seen["version"] in (install_check.installed_version() or "")
    assert seen["package"] == str(tmp_path / "new" / "moved" / "mujoco")
    (engine,) = package.glob("libmujoco.so*")
    (extension,) = package.glob("_functions.*.so")
    for library, name, key, shift in (
        (engine, "mj_step", "mj_step", placement.engine_bytes),
        (extension, "PyInit__functions", "extension", placement.extension_bytes),
    ):
        assert (seen[key] - address_modulo_page(library, name)) % 4096 == shift
    after = {f: (f.stat().st_size, f.stat().st_mtime_ns) for f in package.iterdir() if f.is_file()}
    assert after == before
    assert install_check.changed_file() is None


# Of 64 bytes 16 stay. Numbers are at 8 and 24, permissions at 1, an instruction at 40.
CONTENT = bytes(range(64))
LIBRARY = MovableImage(
    insert_at=16,
    addresses=np.array([8, 24]),
    permissions=np.array([[1, 5]]),
    unaligned=np.array([[40, 0x10], [41, 0x11]]),
)


def number(content: bytes, place: int) -> int:
    return int.from_bytes(content[place : place + 8], "little")


@pytest.mark.parametrize("shift", [16, 32, 48, 4080])
def test_bytes_are_inserted_and_numbers_grow_by_as_many(shift: int) -> None:
    result = moved(LIBRARY, CONTENT, shift)
    assert len(result) == len(CONTENT) + shift
    assert result[16 : 16 + shift] == bytes(shift)
    assert number(result, 8) == number(CONTENT, 8) + shift
    assert number(result, 24 + shift) == number(CONTENT, 24) + shift
    assert result[1] == 5


@pytest.mark.parametrize("shift", [16, 32])
def test_nothing_else_changes(shift: int) -> None:
    result = moved(LIBRARY, CONTENT, shift)
    back = bytearray(result[:16] + result[16 + shift :])
    named = {*range(8, 16), *range(24, 32), 1, 40, 41}
    assert all(back[i] == CONTENT[i] for i in set(range(64)) - named)


@pytest.mark.parametrize(("shift", "expected"), [(16, b"\x10\x11"), (32, CONTENT[40:42])])
def test_instructions_change_only_where_vectors_lose_their_alignment(
    shift: int, expected: bytes
) -> None:
    assert moved(LIBRARY, CONTENT, shift)[40 + shift : 42 + shift] == expected


def test_a_library_that_is_moved_by_nothing_is_the_same() -> None:
    assert moved(LIBRARY, CONTENT, 0) == CONTENT


def test_an_address_may_carry_into_its_last_byte() -> None:
    content = bytes(8) + b"\xf8" + 7 * b"\xff" + bytes(16)
    image = MovableImage(0, np.array([8]), *2 * [np.empty((0, 2), np.int64)])
    assert number(moved(image, content, 16), 8 + 16) == 8


def test_a_file_that_exists_is_not_written_over(tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    source.write_bytes(CONTENT)
    target.write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        LIBRARY.write(source, target, 16)
    assert target.read_bytes() == b"mine"
