"""What moves in an install: where it is kept, and why it is not known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjbench.errors import MachineError
from mjbench.releases import image_reader, installs, movable
from mjbench.releases.moved_install import ImmovableError, MovableImage


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Return a folder with a package of two libraries, recorded."""
    folder = tmp_path / "site"
    (folder / "mujoco").mkdir(parents=True)
    for name in ("libmujoco.so.9.9.9", "_structs.x.so", "_enums.x.so"):
        (folder / "mujoco" / name).write_bytes(name.encode())
    (folder / "mujoco-9.9.9.dist-info").mkdir()
    (folder / "mujoco-9.9.9.dist-info" / "RECORD").touch()
    return folder


@pytest.fixture(autouse=True)
def on_linux(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(movable.sys, "platform", "linux")
    monkeypatch.setattr(movable.platform, "machine", lambda: "x86_64")
    monkeypatch.setenv("MJBENCH_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def readings(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Replace the reader by one that notes what it is given."""
    given: list[bytes] = []

    def read(content: bytes) -> MovableImage:
        given.append(content)
        permissions, unaligned = np.array([[4, 5]]), np.array([[20, 0x10]])
        return MovableImage(64, np.array([len(content)]), permissions, unaligned)

    monkeypatch.setattr(image_reader, "read", read)
    return given


def assert_read(install: Any) -> None:
    """Hold an install against what the reader of `readings` found."""
    assert {"libmujoco.so.9.9.9", "_structs.x.so"} == set(install.images)
    for name, image in install.images.items():
        assert (image.insert_at, image.addresses.tolist()) == (64, [len(name)])
        assert (image.permissions.tolist(), image.unaligned.tolist()) == ([[4, 5]], [[20, 0x10]])


def test_a_library_is_read_once_and_again_when_it_changes(
    site: Path, readings: list[bytes]
) -> None:
    assert_read(movable.read(site))
    assert_read(movable.read(site))
    assert sorted(readings) == [b"_structs.x.so", b"libmujoco.so.9.9.9"]
    (site / "mujoco" / "_structs.x.so").write_bytes(b"_structs.X.so")
    assert_read(movable.read(site))
    assert readings[2:] == [b"_structs.X.so"]


@pytest.mark.parametrize("size", [0, 1, 100, 700])
def test_a_damaged_cache_is_read_again_and_repaired(
    site: Path, readings: list[bytes], size: int
) -> None:
    movable.read(site)
    cached = list((installs.cache_folder() / "images").glob("*.npz"))
    for file in cached:
        file.write_bytes(file.read_bytes()[:size])
    assert_read(movable.read(site))
    assert len(readings) == 4
    assert_read(movable.read(site))
    assert len(readings) == 4
    assert len(cached) == 2


def test_a_cache_that_cannot_be_written_only_costs_time(
    site: Path, readings: list[bytes], tmp_path: Path
) -> None:
    (tmp_path / "cache").write_text("a file, in which no folder can be created")
    install = movable.read(site)
    assert_read(install)
    movable.note_checked(install)
    assert not movable.was_checked(install)


def test_a_user_without_a_home_folder_has_no_cache(
    site: Path, readings: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> Path:
        raise MachineError("no home folder is known")

    monkeypatch.setattr(installs, "cache_folder", fail)
    install = movable.read(site)
    assert_read(install)
    movable.note_checked(install)
    assert not movable.was_checked(install)


def test_what_was_checked_is_known_until_a_library_changes(
    site: Path, readings: list[bytes]
) -> None:
    install = movable.read(site)
    assert not movable.was_checked(install)
    movable.note_checked(install)
    assert movable.was_checked(movable.read(site))
    (site / "mujoco" / "_structs.x.so").write_bytes(b"another")
    assert not movable.was_checked(movable.read(site))


@pytest.mark.parametrize(("system", "machine"), [("darwin", "x86_64"), ("linux", "aarch64")])
def test_elsewhere_nothing_moves(
    site: Path, monkeypatch: pytest.MonkeyPatch, system: str, machine: str
) -> None:
    monkeypatch.setattr(movable.sys, "platform", system)
    monkeypatch.setattr(movable.platform, "machine", lambda: machine)
    with pytest.raises(ImmovableError, match="only libraries for Linux on x86-64"):
        movable.read(site)


@pytest.mark.parametrize(
    ("lost", "message"),
    [
        ("mujoco/libmujoco.so.9.9.9", "holds no libmujoco"),
        ("mujoco-9.9.9.dist-info/RECORD", "no installer recorded its files"),
    ],
)
@pytest.mark.usefixtures("readings")
def test_an_incomplete_install_does_not_move(site: Path, lost: str, message: str) -> None:
    (site / lost).unlink()
    with pytest.raises(ImmovableError, match=message):
        movable.read(site)


def test_a_package_elsewhere_does_not_move(tmp_path: Path) -> None:
    """An editable install has its files in another folder."""
    with pytest.raises(ImmovableError, match="cannot be read: No such file"):
        movable.read(tmp_path / "nothing")


def test_a_library_that_cannot_be_moved_is_named(site: Path) -> None:
    with pytest.raises(
        ImmovableError, match=r"^_structs\.x\.so: it is no shared library for Linux"
    ):
        movable.read(site)
