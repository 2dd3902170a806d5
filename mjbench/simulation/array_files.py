"""Files of arrays that users give: opened only if what they expand to fits into memory."""

import zipfile
from typing import BinaryIO

import numpy as np

from mjbench.errors import InputError

# Bytes that the arrays which are read from a file may have together.
MOST_BYTES = 1 << 30


def load(stream: BinaryIO, name: str, fields: frozenset[str] | None = None) -> object:
    """Return what `numpy.load` does of a file: an array of an .npy file, or those of an .npz file.

    A small .npz file may expand to any size. A member never gives more than its directory says.

    Args:
      name: of the file, for messages.
      fields: the arrays that will be read; None for all.

    Raises:
      InputError: they are too large.
      Exception: the file is damaged; NumPy and zipfile raise many kinds.
    """
    if zipfile.is_zipfile(stream):
        with zipfile.ZipFile(stream) as members:
            expanded = sum(
                member.file_size
                for member in members.infolist()
                if fields is None or member.filename.removesuffix(".npy") in fields
            )
        if expanded > MOST_BYTES:
            raise InputError(
                f"{name} expands to {expanded / 1e9:.1f} GB; at most {MOST_BYTES / 1e9:.1f} GB can"
                " be read: save fewer rows"
            )
    stream.seek(0)
    return np.load(stream, allow_pickle=False)


def floats(values: np.ndarray, name: str) -> np.ndarray:
    """Return numbers as float64, in which small integers take eight times their space.

    Raises:
      InputError: they would be too large.
    """
    if values.size * np.dtype(float).itemsize > MOST_BYTES:
        raise InputError(f"{name} has {values.size:,} numbers, which is too many: save fewer rows")
    return values.astype(float)
