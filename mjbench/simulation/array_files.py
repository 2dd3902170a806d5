"""Files of arrays that users give: opened only if what they expand to fits into memory."""

import zipfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjbench.errors import InputError, one_line, shown

# Bytes that the arrays which are read from a file may have together.
MOST_BYTES = 1 << 30


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """The arrays that were read from a file, and the names of all that it has.

    An .npy file has one without a name, and no others.
    """

    arrays: Mapping[str, np.ndarray]
    names: Sequence[str]
    unnamed: np.ndarray | None = None

    @property
    def listing(self) -> str:
        return shown(", ".join(self.names[:8])) if self.names else "nothing"


def read(file: Path, what: str, fields: Collection[str]) -> ArrayFile:
    """Return the arrays of a file that are named like fields; InputError if it cannot be read."""
    name = shown(file.name)
    try:
        if zipfile.is_zipfile(file):
            _check_size(file, fields)
        with file.open("rb") as stream:
            loaded: Any = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return ArrayFile({}, [], loaded)
            # NumPy gives a member that is no array as bytes
            arrays = {key: np.asarray(loaded[key]) for key in loaded.files if key in fields}
            return ArrayFile(arrays, loaded.files)
    except InputError:
        raise
    except Exception as error:  # a damaged file: NumPy and zipfile raise many kinds
        raise InputError(
            f"cannot read {what} from {name}: {one_line(error)}; numpy.savez writes such files"
        ) from error


def _check_size(file: Path, fields: Collection[str]) -> None:
    """Refuse a small .npz file that expands to more: no member gives more than its entry says."""
    with zipfile.ZipFile(file) as members:
        expanded = sum(
            member.file_size
            for member in members.infolist()
            if member.filename.removesuffix(".npy") in fields
        )
    if expanded > MOST_BYTES:
        raise InputError(
            f"{shown(file.name)} expands to {expanded / 1e9:.1f} GB; at most"
            f" {MOST_BYTES / 1e9:.1f} GB can be read: save fewer rows"
        )


def floats(values: np.ndarray, name: str) -> np.ndarray:
    """Return finite numbers as float64, if they fit into memory; else InputError."""
    if values.dtype.kind not in "fiub":
        raise InputError(f"{name} does not hold numbers")
    if values.size * np.dtype(float).itemsize > MOST_BYTES:
        raise InputError(f"{name} has {values.size:,} numbers, which is too many: save fewer rows")
    if not np.isfinite(values).all():
        raise InputError(f"{name} holds numbers that are not finite")
    return values.astype(float)
