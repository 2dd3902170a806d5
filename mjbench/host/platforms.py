"""What this operating system can do, and which commands run on it.

Linux can do everything. macOS cannot keep a process on a core, and its kernel does not end a child
with its parent. On Windows only commands that start no process run.

Every process imports this module, so it needs only the standard library.
"""

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from mjbench.errors import MachineError

# The commands that start no process, and so run on Windows.
RUN_ON_WINDOWS = ("lint", "show", "paths")
# How often a process looks for its parent where the kernel does not end it, in seconds. This takes
# some microseconds, beside a timed block or in it.
_PARENT_CHECK_S = 1.0
# Of <sys/personality.h>: no random addresses in programs that are started; and to change nothing.
_NO_RANDOM_ADDRESSES, _UNCHANGED = 0x0040000, 0xFFFFFFFF


def check_command(command: str) -> None:
    if sys.platform == "win32" and command not in RUN_ON_WINDOWS:
        raise MachineError(
            f"`mjbench {command}` does not run on Windows; use WSL2. Commands that run on Windows:"
            f" {', '.join(RUN_ON_WINDOWS)}"
        )


def affinity() -> set[int]:
    """Return the cores that this process may run on; none where the system has no affinity."""
    if sys.platform == "linux":
        return os.sched_getaffinity(0)
    return set()


def set_affinity(pid: int, cores: Iterable[int]) -> None:
    if sys.platform == "linux":
        os.sched_setaffinity(pid, cores)


def forbids_programs(folder: Path) -> bool:
    """Return whether no library can be loaded from a folder: its file system is mounted noexec."""
    if sys.platform == "linux":
        return bool(os.statvfs(folder).f_flag & os.ST_NOEXEC)
    return False


def pinning_notes() -> list[str]:
    """Return what it means that processes cannot be kept on a core; nothing where they can."""
    if sys.platform == "linux":
        return []
    return [
        "this system cannot keep a process on one core:"
        " times spread more than on Linux, and verdicts take longer"
    ]


def can_adopt() -> bool:
    if sys.platform != "linux" or not hasattr(os, "pidfd_open"):  # not every build of Python has it
        return False
    try:
        os.close(os.pidfd_open(os.getpid()))
    except OSError:  # an old kernel, or a container that forbids it
        return False
    return True


def can_fix_addresses() -> bool:
    """Return whether `fixed_addresses` works here; containers can forbid it."""
    with fixed_addresses():
        personality = _personality()
        flags = -1 if personality is None else personality(_UNCHANGED)
        return flags >= 0 and bool(flags & _NO_RANDOM_ADDRESSES)


@contextlib.contextmanager
def fixed_addresses() -> Iterator[None]:
    """Have programs that this thread starts lie at the same addresses each time, where possible.

    By default Linux draws the addresses of each program that is started.
    """
    personality = _personality()
    before = -1 if personality is None else personality(_UNCHANGED)
    if personality is None or before < 0:
        yield
        return
    personality(before | _NO_RANDOM_ADDRESSES)
    try:
        yield
    finally:
        personality(before)


@functools.cache
def _personality() -> Callable[[int], int] | None:
    if sys.platform != "linux":
        return None
    import ctypes

    function = getattr(ctypes.CDLL(None), "personality", None)
    if function is not None:
        function.argtypes, function.restype = [ctypes.c_ulong], ctypes.c_int
    return function


def can_count_instructions() -> bool:
    return sys.platform == "linux"


def end_with_parent() -> None:
    """End this process soon after its parent, where the kernel cannot: a thread looks for it.

    A process in which other code keeps Python's threads from running ends when that code does.
    """
    if sys.platform == "win32":
        return
    import threading
    import time

    def exit_after(parent: int) -> None:
        while os.getppid() == parent != 1:  # which is the parent of an orphan
            time.sleep(_PARENT_CHECK_S)
        os._exit(1)

    threading.Thread(target=exit_after, args=(os.getppid(),), daemon=True).start()


def lock_file(descriptor: int, *, shared: bool, wait: bool) -> None:
    """Lock an open file by flock; the kernel frees the lock when the process ends."""
    if sys.platform == "win32":
        raise NotImplementedError("no command that installs a release runs on Windows")
    import fcntl

    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    fcntl.flock(descriptor, kind if wait else kind | fcntl.LOCK_NB)
