"""Read what moves in an installed release, once: the result is kept in the cache folder.

The cache only saves time. Where its folder cannot be written, a release is read every time.
"""

import contextlib
import io
import platform
import sys
from importlib import metadata
from pathlib import Path

import numpy as np

from mjbench.errors import MachineError
from mjbench.host import files
from mjbench.releases import image_reader, installs, moved_install
from mjbench.releases.moved_install import ImmovableError, MovableImage, MovableInstall

# Part of the names of cached files: another when what they hold changes.
_FORMAT = "v3"
# The fields of a `MovableImage` that are arrays.
_ARRAYS = ("addresses", "permissions", "unaligned")
# How the names of notes end that an install was checked; another when it is moved otherwise.
_CHECKED = "checked-relro"


def site_folder(install: Path | None) -> Path:
    """Return the folder with the mujoco package; ImmovableError if no installer recorded it."""
    if install is not None:
        return install
    try:
        return Path(str(metadata.distribution("mujoco").locate_file("")))
    except metadata.PackageNotFoundError as error:
        raise ImmovableError("no installer recorded MuJoCo") from error


def read(site: Path) -> MovableInstall:
    """Return what moves in a release, after seconds the first time; else ImmovableError."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise ImmovableError("only libraries for Linux on x86-64 can be moved")
    try:
        libraries = [file for file in (site / "mujoco").iterdir() if moved_install.moves(file.name)]
        versions = {file.name: moved_install.file_version(file) for file in libraries}
        contents = {file.name: file.read_bytes() for file in sorted(libraries)}
    except OSError as error:
        raise ImmovableError(f"its libraries cannot be read: {error.strerror}") from error
    if not any(name.startswith(moved_install.ENGINE) for name in contents):
        raise ImmovableError("its package holds no libmujoco")
    if not moved_install.is_recorded(site):
        raise ImmovableError("no installer recorded its files")
    images = {}
    for name, content in contents.items():
        try:
            images[name] = _image(content)
        except ImmovableError as error:
            raise ImmovableError(f"{name}: {error}") from error
    everything = moved_install.digest(b"".join(contents.values()))
    return MovableInstall(site, images, versions, everything)


def was_checked(install: MovableInstall) -> bool:
    file = _cached(install.digest, _CHECKED)
    return file is not None and file.exists()


def note_checked(install: MovableInstall) -> None:
    file = _cached(install.digest, _CHECKED)
    if file is not None:
        with contextlib.suppress(OSError), files.replacing(file):
            pass


def _image(content: bytes) -> MovableImage:
    file = _cached(moved_install.digest(content), "npz")
    if file is None:
        return image_reader.read(content)
    try:
        with np.load(io.BytesIO(file.read_bytes())) as stored:  # itself it leaves bad files open
            return MovableImage(int(stored["insert_at"]), *(stored[name] for name in _ARRAYS))
    except Exception:  # it is missing or damaged: read the library again
        image = image_reader.read(content)
    arrays = {name: getattr(image, name) for name in _ARRAYS}
    with (
        contextlib.suppress(OSError),
        files.replacing(file) as partial,
        partial.open("wb") as stream,
    ):
        np.savez(stream, insert_at=image.insert_at, **arrays)
    return image


def _cached(name: str, suffix: str) -> Path | None:
    """Return a file of the cache, which a user without a home folder has not."""
    try:
        return installs.cache_folder() / "images" / f"{name}-{_FORMAT}.{suffix}"
    except MachineError:
        return None
