"""Move the image of a shared library within its pages: the same code at other addresses.

Where a loop lies within its cache lines decides percents of its speed. The system loads a library
at whole pages, so that position is fixed when the library is built. Here bytes are inserted behind
the program headers, and every number that is an address or a place in the file grows by as many.
Code and data move together, so that distances between them stay right.

This runs in a process that is about to import a release: it needs NumPy alone. `image_reader` finds
what has to change.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

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
        """Write the library's file, moved, to another one; return its size in bytes.

        The inserted bytes are a hole in the file, which takes up no space and reads as zeros.

        Args:
          source: as installed.
          shift: bytes to move by, as a `Placement` holds them.

        Raises:
          OSError: the one cannot be read, or the other not written.
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
        """Change in the library's bytes what changes when it is moved."""
        numbers = content[: len(content) // 8 * 8].view("<u8")
        numbers[self.addresses // 8] += np.uint64(shift)
        content[self.permissions[:, 0]] = self.permissions[:, 1]
        if shift % _VECTOR_BYTES:
            content[self.unaligned[:, 0]] = self.unaligned[:, 1]
