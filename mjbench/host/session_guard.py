"""A process that outlives this one, to end what this one leaves behind.

The kernel ends children with their parent where they ask for it; it does not end what these start.
Ray's agents, for one, look for their server for a minute after it was killed. Linux only.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from mjbench.errors import MachineError, one_line

# The program of the guard. It gets the number of the session, and reads until the pipe is closed.
_GUARD = "import sys; from mjbench.host.session_guard import guard; guard(int(sys.argv[1]))"
# How often processes are looked for, as they may start others while they are killed, and how many
# seconds pass between two searches.
_SEARCHES, _PAUSE_S = 500, 0.01
_ROOT = str(Path(__file__).resolve().parents[2])


def start() -> Callable[[], None]:
    """Have a process kill the session that this process leads when this process ends.

    Where this process leads no session, there is no guard: others may be in its session. What is
    returned dismisses the guard.
    """
    if sys.platform != "linux" or os.getsid(0) != os.getpid():
        return lambda: None
    try:
        process = subprocess.Popen(
            [sys.executable, "-S", "-c", _GUARD, str(os.getpid())],
            stdin=subprocess.PIPE,  # closed when this process ends, however it ends
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd="/",
            env={**os.environ, "PYTHONPATH": _ROOT},
        )
    except OSError as error:
        raise MachineError(f"cannot start a process: {one_line(error)}") from error

    def dismiss() -> None:
        with process:  # closes the pipe, and waits
            process.kill()

    return dismiss


def guard(session: int) -> None:
    """Wait until the pipe at the standard input is closed, and kill a session but this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.stdin.buffer.read()
    for _ in range(_SEARCHES):
        members = _members(session)
        if not members:
            return
        for pid in members:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(_PAUSE_S)


def _members(session: int) -> list[int]:
    """Return the processes of a session, without zombies and without this one."""
    members = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        pid = int(file.parent.name)
        with contextlib.suppress(OSError):
            # PID (NAME) STATE PARENT GROUP SESSION …, where NAME may have any characters
            state, _, _, its_session = file.read_text().rpartition(")")[2].split()[:4]
            if int(its_session) == session and state != "Z" and pid != os.getpid():
                members.append(pid)
    return members
