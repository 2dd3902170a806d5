"""Write a file so that a reader sees either the earlier one or the whole new one."""

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yield an empty file beside `file`, which takes its place when the block ends well."""
    partial = create_beside(file)
    try:
        yield partial
        put_in_place(partial, file)
    finally:
        partial.unlink(missing_ok=True)


def create_beside(file: Path) -> Path:
    descriptor, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    os.close(descriptor)
    return Path(name)


def put_in_place(partial: Path, file: Path) -> None:
    """Rename a complete file to `file`, with the permissions of the one that it replaces."""
    try:
        permissions = stat.S_IMODE(file.stat().st_mode)
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        permissions = 0o666 & ~mask
    partial.chmod(permissions)
    partial.replace(file)
