"""Files that are whole or not there, and temporary folders that go even if a process is killed."""

import contextlib
import hashlib
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from mjbench.errors import MachineError, one_line

# Names of temporary folders are this, `_pid_namespace()`, the owner's process id, and a random
# ending.
_PREFIX = "mjbench-"


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a temporary folder, after those of processes that were killed are removed."""
    prefix = f"{_PREFIX}{_pid_namespace()}-"
    try:
        for other in Path(tempfile.gettempdir()).glob(f"{prefix}*-*"):
            owner = other.name.removeprefix(prefix).partition("-")[0]
            if owner.isascii() and owner.isdecimal() and not _is_running(int(owner)):
                shutil.rmtree(other, ignore_errors=True)
        own = tempfile.TemporaryDirectory(
            prefix=f"{prefix}{os.getpid()}-", ignore_cleanup_errors=True
        )
    except OSError as error:
        raise MachineError(
            f"cannot create a temporary folder: {one_line(error)}; set TMPDIR"
        ) from error
    with own as name:
        yield Path(name)


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)  # sends nothing
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return True


def _pid_namespace() -> str:
    """Return 8 hexadecimal digits that name this machine, or this container, by its process ids.

    The temporary folder may be shared with containers, in which a process id is another process.
    """
    try:
        namespace = str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        namespace = ""
    return hashlib.blake2b(
        f"{socket.gethostname()} {namespace}".encode(), digest_size=4
    ).hexdigest()


@contextlib.contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yield an empty file beside `file`, which takes its place when the block ends well.

    The folder is created where it is missing.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
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
