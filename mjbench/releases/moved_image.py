"""Move the image of a shared library within its pages: the same code at other addresses.

Where a loop lies within its cache lines decides percents of its speed. The system loads a library
at whole pages, so that position is fixed when the library is built. Here bytes are inserted behind
the program headers, and every number that is an address or a place in the file grows by as many.
Code and data move together, so that distances between them stay right.

This runs in a process that is about to import a release: it needs NumPy alone. `image_reader` finds
what has to change.
"""

from dataclasses import dataclass

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
      addresses: (n,) places in the file of 8-byte numbers that grow by the shift.
      permissions: (n, 2) places of bytes that say what a segment may be used for, and what each
        becomes, because the segment may come to share a page with the one before it.
      unaligned: (n, 2) places of bytes in instructions on vectors, and what each becomes where
        vectors lose their alignment.
    """

    insert_at: int
    addresses: np.ndarray
    permissions: np.ndarray
    unaligned: np.ndarray

    def moved(self, content: bytes, shift: int) -> bytes:
        """Return the content of the library's file, moved.

        Args:
          content: as installed.
          shift: bytes to move by, as a `Placement` holds them.
        """
        if not shift:
            return content
        result = np.empty(len(content) + shift, np.uint8)
        source = np.frombuffer(content, np.uint8).copy()
        places = self.addresses[:, None] + np.arange(8)
        source[places] = (source[places].view("<u8") + np.uint64(shift)).view(np.uint8)
        source[self.permissions[:, 0]] = self.permissions[:, 1]
        if shift % _VECTOR_BYTES:
            source[self.unaligned[:, 0]] = self.unaligned[:, 1]
        result[: self.insert_at] = source[: self.insert_at]
        result[self.insert_at : self.insert_at + shift] = 0
        result[self.insert_at + shift :] = source[self.insert_at :]
        return result.tobytes()
