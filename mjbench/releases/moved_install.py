"""An installed release whose libraries are moved: as the original, but for where its code lies.

Where a loop lies within its cache lines decides percents of its speed. The system loads a library
at whole pages, so that position is fixed when the library is built. Here bytes are inserted behind
the program headers, and every number that is an address or a place in the file grows by as many.
Code and data move together, so that distances between them stay right.

Moved libraries are not stored: every process of a launch creates its own before it imports MuJoCo,
which takes about 15 ms. So this module needs NumPy alone; `movable` and `image_reader` find what
moves.
"""

import hashlib
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjbench.releases.install_check import DISTRIBUTIONS
from mjbench.releases.placement import Placement

# What the names of libraries begin with that a step runs through.
ENGINE = "libmujoco."
_EXTENSIONS = ("_functions.", "_structs.", "_rollout.", "_batch.")
_PACKAGE = "mujoco"
# The file in which an installer recorded the files of a distribution.
_RECORD = "RECORD"
# Instructions on vectors of 32 bytes in memory exist in two forms of equal length: one faults
# unless the address is a multiple of 32, the other works at any address.
_VECTOR_BYTES = 32


class ImmovableError(Exception):
    """A library cannot be moved; the message says why."""


@dataclass(frozen=True, eq=False)
class MovableImage:
    """What changes in a shared library when it is moved.

    Attributes:
      insert_at: place in the file where bytes are inserted; whatever lies before it stays.
      addresses: (n,) places in the file of 8-byte numbers that grow by the shift; multiples of 8.
      permissions: (n, 2) places of bytes that say what a segment may be used for, and what each
        becomes, because the segment may come to share a page with the one before it.
      unaligned: (n, 2) places of bytes in instructions on vectors, and what each becomes where
        vectors lose their alignment.
    """

    insert_at: int
    addresses: np.ndarray
    permissions: np.ndarray
    unaligned: np.ndarray

    def write(self, source: Path, target: Path, shift: int) -> int:
        """Write the library's file, moved by some bytes, to another one; return its size in bytes.

        The inserted bytes are a hole in the file, which takes up no space and reads as zeros.
        """
        content = np.fromfile(source, np.uint8)
        if shift:
            self._change(content, shift)
        with target.open("xb") as file:
            file.write(content[: self.insert_at].data)
            file.seek(shift, os.SEEK_CUR)
            file.write(content[self.insert_at :].data)
        return len(content) + shift

    def _change(self, content: np.ndarray, shift: int) -> None:
        numbers = content[: len(content) // 8 * 8].view("<u8")
        numbers[self.addresses // 8] += np.uint64(shift)
        content[self.permissions[:, 0]] = self.permissions[:, 1]
        if shift % _VECTOR_BYTES:
            content[self.unaligned[:, 0]] = self.unaligned[:, 1]


@dataclass(frozen=True, eq=False)
class MovableInstall:
    """A release whose libraries can be moved: its folder, and what changes in each, by file name.

    Attributes:
      versions: of the files that were read, by name (see `file_version`).
    """

    site: Path
    images: Mapping[str, MovableImage]
    versions: Mapping[str, tuple[int, int]]
    digest: str

    def link_others(self, folder: Path) -> None:
        """Link whatever lies beside the package, such as NumPy, into a new folder."""
        folder.mkdir()
        own = {_PACKAGE, *(metadata.name for metadata in _metadata_folders(self.site))}
        for entry in self.site.iterdir():
            if entry.name not in own:
                (folder / entry.name).symlink_to(entry)

    def use(self, folder: Path, others: Path, placement: Placement) -> Path:
        """Create a moved install, for this process to import; return the folder of its package.

        `others` is what `link_others` filled.
        """
        self.create(folder, placement)
        site = self.site.resolve()
        folders: list[str] = []
        for name in sys.path:
            if Path(name).resolve() != site:
                folders.append(name)
            elif str(folder) not in folders:  # it takes the place of the original
                folders += [str(folder), str(others)]
        sys.path[:] = folders
        return folder / _PACKAGE

    def create(self, folder: Path, placement: Placement) -> None:
        package = folder / _PACKAGE
        package.mkdir(parents=True)
        sizes = {}
        for entry in (self.site / _PACKAGE).iterdir():
            image = self.images.get(entry.name)
            if image is None:
                _link(entry, package / entry.name)
                continue
            is_engine = entry.name.startswith(ENGINE)
            shift = placement.engine_bytes if is_engine else placement.extension_bytes
            if file_version(entry) != self.versions[entry.name]:
                raise ImmovableError(f"{entry.name} was changed while it was being measured")
            size = image.write(entry, package / entry.name, shift)
            sizes[f"{_PACKAGE}/{entry.name}"] = size
        for metadata in _metadata_folders(self.site):
            _link_metadata(metadata, folder / metadata.name, sizes)


def file_version(file: Path) -> tuple[int, int]:
    """Return the size of a file and when it was modified, in ns: others if it was replaced."""
    status = file.stat()
    return status.st_size, status.st_mtime_ns


def moves(name: str) -> bool:
    return name.startswith((ENGINE, *_EXTENSIONS)) and ".so" in name


def is_recorded(site: Path) -> bool:
    folders = list(_metadata_folders(site))
    return bool(folders) and all((folder / _RECORD).is_file() for folder in folders)


def digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def _metadata_folders(site: Path) -> Iterator[Path]:
    for name in DISTRIBUTIONS:
        yield from site.glob(f"{name.replace('-', '_')}-*.dist-info")


def _link(entry: Path, link: Path) -> None:
    """Create a link: symbolic for a folder, hard for a file."""
    if entry.is_dir():
        link.symlink_to(entry)
        return
    try:
        os.link(entry, link)
    except OSError:  # another file system, or one without links
        shutil.copy2(entry, link)


def _link_metadata(source: Path, target: Path, sizes: Mapping[str, int]) -> None:
    """Link a folder of metadata; files that were moved get their new size there, and no hash."""
    target.mkdir()
    for entry in source.iterdir():
        if entry.name != _RECORD:
            _link(entry, target / entry.name)
    rows = (source / _RECORD).read_text(encoding="utf-8").splitlines()
    for i, row in enumerate(rows):
        name = row.partition(",")[0]  # CSV; the names of libraries are never in quotes
        if name in sizes:
            rows[i] = f"{name},,{sizes[name]}"
    (target / _RECORD).write_text("\n".join([*rows, ""]), encoding="utf-8")
