"""Temporary folders that are removed even if their process is killed: by the next one."""

import contextlib
import hashlib
import os
import shutil
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

from mjbench.errors import MachineError, one_line

# Names of temporary folders are this, `_pid_namespace()`, the owner's process id, and a random
# ending.
_PREFIX = "mjbench-"


@contextlib.contextmanager
def folder() -> Iterator[Path]:
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
