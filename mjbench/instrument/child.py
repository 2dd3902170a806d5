"""Child processes: they die with their parent, are ended whole, and leave no folder.

Imported by everything that starts one or is one, so it imports next to nothing at first.
"""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from mjbench.errors import MachineError, one_line

_PR_SET_PDEATHSIG = 1
# Begins the names of folders for a while; where and what made them follows.
_SCRATCH = "mjbench-"


def die_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends (Linux)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """Yield a folder that lasts as long as the block.

    Those of processes that were killed, and could not remove theirs, are removed first.

    Raises:
      MachineError: it cannot be made.
    """
    import shutil
    import tempfile

    ours = f"{_SCRATCH}{_place()}-"
    try:
        for folder in Path(tempfile.gettempdir()).glob(f"{ours}*-*"):
            owner = folder.name.removeprefix(ours).partition("-")[0]
            if owner.isdigit() and Path("/proc").is_dir() and not Path(f"/proc/{owner}").exists():
                shutil.rmtree(folder, ignore_errors=True)
        made = tempfile.TemporaryDirectory(
            prefix=f"{ours}{os.getpid()}-", ignore_cleanup_errors=True
        )
    except OSError as error:
        raise MachineError(
            f"no folder for files of a while: {one_line(error)}; name one by TMPDIR"
        ) from error
    with made as name:
        yield Path(name)


def _place() -> str:
    """Return a name of where process ids mean the same: this machine, or this container of it."""
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
    """Kill a child that leads a session of its own, with all it started; return its exit code."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)
    return child.wait()


def cause_of_death(code: int) -> str:
    """Return in words how a process ended, from its exit code or minus its signal."""
    if code >= 0:
        return f"the process ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    return f"killed by signal {-code} ({name})"


def memory_bytes(pid: int) -> int:
    """Return the memory that a process has now, in bytes; 0 where the system does not tell."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0


def last_words(said: str) -> str:
    """Return the last line of what a process wrote, as the end of a sentence."""
    lines = said.strip().splitlines()
    return f"; it said: {one_line(lines[-1], 160)}" if lines else ""


def text(path: Path) -> str:
    """Return a file's content, or nothing where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
