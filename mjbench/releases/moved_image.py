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

    def moved(self, content: bytes, shift: int) -> bytes:
        """Return the content of the library's file, moved.

        Args:
          content: as installed.
          shift: bytes to move by, as a `Placement` holds them.
        """
        if not shift:
            return content
        source = np.frombuffer(content, np.uint8)
        result = np.empty(len(content) + shift, np.uint8)
        result[: self.insert_at] = source[: self.insert_at]
        result[self.insert_at : self.insert_at + shift] = 0
        result[self.insert_at + shift :] = source[self.insert_at :]
        numbers = result[: len(result) // 8 * 8].view("<u8")
        numbers[self._places(self.addresses, shift) // 8] += np.uint64(shift)
        result[self._places(self.permissions[:, 0], shift)] = self.permissions[:, 1]
        if shift % _VECTOR_BYTES:
            result[self._places(self.unaligned[:, 0], shift)] = self.unaligned[:, 1]
        return result.tobytes()

    def _places(self, places: np.ndarray, shift: int) -> np.ndarray:
        """Return where places of the file are after it was moved."""
        return np.where(places < self.insert_at, places, places + shift)
