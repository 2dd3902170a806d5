"""Child processes that die with their parent, end with all their children, and leave no files.

Every process that starts a child or is one imports this module, so it imports little at first.
"""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from mjbench.errors import MachineError, one_line
from mjbench.instrument import platforms

_PR_SET_PDEATHSIG = 1
# Names of temporary directories are this, `_pid_namespace()`, the owner's process id, and a
# random ending.
_SCRATCH = "mjbench-"


def die_with_parent() -> None:
    """Have this process end with its parent; on Linux, with the thread that started it."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        platforms.end_with_parent()


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """Yield a temporary directory; it is removed when the block ends.

    Directories of processes that were killed, and could not remove their own, are removed first.

    Raises:
      MachineError: it cannot be created.
    """
    import shutil
    import tempfile

    prefix = f"{_SCRATCH}{_pid_namespace()}-"
    try:
        for folder in Path(tempfile.gettempdir()).glob(f"{prefix}*-*"):
            owner = folder.name.removeprefix(prefix).partition("-")[0]
            if owner.isdigit() and not _is_running(int(owner)):
                shutil.rmtree(folder, ignore_errors=True)
        directory = tempfile.TemporaryDirectory(
            prefix=f"{prefix}{os.getpid()}-", ignore_cleanup_errors=True
        )
    except OSError as error:
        raise MachineError(
            f"cannot create a temporary directory: {one_line(error)}; set TMPDIR"
        ) from error
    with directory as name:
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
    import hashlib
    import socket

    try:
        namespace = str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        namespace = ""
    return hashlib.blake2b(
        f"{socket.gethostname()} {namespace}".encode(), digest_size=4
    ).hexdigest()


def end_group(child: "subprocess.Popen[bytes]") -> int:
    """Kill a child that leads its own session, and all its children; return its exit code."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)
    return child.wait()


def describe_exit(code: int) -> str:
    """Describe how a process ended.

    Args:
      code: its exit code, or minus the signal that killed it.
    """
    if code >= 0:
        return f"the process ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    return f"killed by signal {-code} ({name})"


def memory_bytes(pid: int) -> int:
    """Return how much memory a process occupies now, in bytes; 0 if it has ended.

    It is also 0 where psutil is missing, which is only in the environments of old releases.
    """
    try:
        import psutil
    except ImportError:
        return 0
    try:
        return int(psutil.Process(pid).memory_info().rss)
    except psutil.Error:
        return 0


def last_line(output: str) -> str:
    """Return the last line that a process wrote, as the end of a sentence; empty if it has none."""
    lines = output.strip().splitlines()
    return f"; its last output: {one_line(lines[-1], 160)}" if lines else ""


def text(path: Path) -> str:
    """Return a file's content; empty if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
