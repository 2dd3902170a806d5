"""Read what moves in an installed release, once: the result is kept in the cache folder."""

import platform
import sys
from importlib import metadata
from pathlib import Path

import numpy as np

from mjbench.instrument import files
from mjbench.releases import image_reader, installs, moved_install
from mjbench.releases.moved_image import ImmovableError, MovableImage
from mjbench.releases.moved_install import MovableInstall

# Part of the names of cached files: another when what they hold changes.
_FORMAT = "v1"


def site_folder(install: Path | None) -> Path:
    """Return the folder that holds the mujoco package: an install, or this environment's.

    Raises:
      ImmovableError: this environment has none that an installer recorded.
    """
    if install is not None:
        return install
    try:
        return Path(str(metadata.distribution("mujoco").locate_file("")))
    except metadata.PackageNotFoundError as error:
        raise ImmovableError("no installer recorded MuJoCo") from error


def read(site: Path) -> MovableInstall:
    """Return what moves in the release of a folder.

    Reading takes a few seconds the first time.

    Raises:
      ImmovableError: its libraries cannot be moved here.
    """
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise ImmovableError("only libraries for Linux on x86-64 can be moved")
    try:
        libraries = [file for file in (site / "mujoco").iterdir() if moved_install.moves(file.name)]
        contents = {file.name: file.read_bytes() for file in sorted(libraries)}
    except OSError as error:
        raise ImmovableError(f"its libraries cannot be read: {error.strerror}") from error
    if not any(name.startswith(moved_install.ENGINE) for name in contents):
        raise ImmovableError("its package holds no libmujoco")
    images = {}
    for name, content in contents.items():
        try:
            images[name] = _image(content)
        except ImmovableError as error:
            raise ImmovableError(f"{name}: {error}") from error
    return MovableInstall(site, images)


def checked_file(install: MovableInstall) -> Path:
    """Return the file whose existence says that moved images of an install were seen to work."""
    return _cache_folder() / f"{install.digest}-{_FORMAT}.checked"


def _image(content: bytes) -> MovableImage:
    """Return what changes in a library, from the cache if it is there."""
    file = _cache_folder() / f"{moved_install.digest(content)}-{_FORMAT}.npz"
    try:
        with np.load(file) as stored:
            return MovableImage(int(stored["insert_at"]), stored["addresses"], stored["unaligned"])
    except Exception:  # it is missing or damaged: read the library again
        image = image_reader.read(content)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with files.replacing(file) as partial, partial.open("wb") as stream:
            np.savez(
                stream,
                insert_at=image.insert_at,
                addresses=image.addresses,
                unaligned=image.unaligned,
            )
    except OSError:  # the cache only saves time
        pass
    return image


def _cache_folder() -> Path:
    return installs.cache_folder() / "images"
