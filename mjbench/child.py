"""Child processes: they die with their parent, are ended whole, and leave a word on how they ended.

Imported by everything that starts one or is one, so it imports next to nothing.
"""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from mjbench.errors import one_line

_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends (Linux)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


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
