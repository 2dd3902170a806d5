"""The files that names and folders stand for."""

import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_SUFFIX = ".py"
_CHECKPOINTS = ".ipynb_checkpoints"  # copies that Jupyter saves


@dataclass(frozen=True)
class UncheckedFile:
    """A file or a folder that could not be checked.

    Attributes:
      file: its name, as given.
      detail: why, in one line.
    """

    file: str
    detail: str


def script_files(names: Sequence[str]) -> list[str | UncheckedFile]:
    """Return the files that are named, and all Python files below the folders.

    Links to folders are not followed. A folder that cannot be listed, or has no such file, stands
    in the list itself.
    """
    files: list[str | UncheckedFile] = []
    for name in names:
        files += _files_below(name) if stat.S_ISDIR(_mode(name)) else [name]
    return files


def regular_files(files: Sequence[str | UncheckedFile]) -> list[Path]:
    return [Path(f) for f in files if isinstance(f, str) and stat.S_ISREG(_mode(f))]


def _mode(name: str) -> int:
    """Return the mode of what a name stands for; 0 where it cannot be known."""
    try:
        return Path(name).stat().st_mode if name else 0
    except (OSError, ValueError):  # reading the file reports it
        return 0


def _files_below(folder: str) -> list[str | UncheckedFile]:
    entries: dict[str, str | UncheckedFile] = {}

    def refuse(error: OSError) -> None:
        name = str(Path(error.filename or folder))
        entries[name] = UncheckedFile(name, f"cannot be listed: {error.strerror}")

    for parent, subfolders, names in os.walk(folder, onerror=refuse):
        subfolders[:] = [name for name in subfolders if name != _CHECKPOINTS]
        files = [str(Path(parent, name)) for name in names if name.endswith(_SUFFIX)]
        entries.update(zip(files, files, strict=True))
    if not entries:
        return [UncheckedFile(folder, "no Python file in this folder")]
    return [entry for _, entry in sorted(entries.items())]
