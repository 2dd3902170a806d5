"""Child processes that die with their parent, and end with all their children.

A child is found with everything that it started: by its process group, by who started whom, by its
session, and by a mark in the environment, which a process that left all these still has. A process
that also cleared its environment is ended when `mjbench` ends.

Every process that starts a child or is one imports this module, so it imports little at first.
"""

import contextlib
import os
import select
import signal
import subprocess
import sys
import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from mjbench.errors import MachineError, one_line
from mjbench.host import platforms

if TYPE_CHECKING:
    import psutil

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 1, 36, 37
# The environment variable that marks a child and what it starts. Each child has its own value,
# which begins with that of this process.
MARK = "MJBENCH_CHILD"
_OWN_MARK = uuid.uuid4().hex
# The signals that may raise an exception: those that interrupt, and the alarm of `interrupts`.
_DELAYED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM")
# A program that ends with its parent: it is not a `preexec_fn`, for which Python runs hooks of fork
# in this process, where it would drop Ctrl-C. Python ignores two signals, programs do not.
_START = f"""\
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl({_PR_SET_PDEATHSIG}, signal.SIGKILL)
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
if os.getppid() == int(sys.argv[1]):
    os.execvp(sys.argv[2], sys.argv[2:])
"""
_ENDING_WITH_PARENT = (sys.executable, "-I", "-S", "-c", _START)
# Descendants may start others while they are ended: they are looked for at most so often, and
# awaited for so many seconds.
_SEARCHES, _DEATH_S = 10, 5.0
# The end of a log in which its last line is looked for, in bytes.
_TAIL_BYTES = 1 << 16


class ChildProcess(ABC):
    """A child that leads a session of its own, and all that it starts."""

    pid: int

    def __init__(self, mark: str):
        self._mark = mark
        self._has_ended = False

    @abstractmethod
    def wait(self, timeout_s: float | None = None) -> int | None:
        """Wait until the child has ended, at most so long; return its exit code, or None.

        The exit code is minus the signal that killed it, if one did.
        """

    def end(self) -> int:
        """Kill the child with everything that it started; return its exit code, now and later."""
        if not self._has_ended:
            if self.wait(0.0) is None:  # otherwise its id may be another process's by now
                offspring = _descendants(self.pid)
                for kill in (os.killpg, os.kill):  # it may not lead its group yet
                    with contextlib.suppress(ProcessLookupError, PermissionError):
                        kill(self.pid, signal.SIGKILL)
                _kill(offspring)
                self.wait()
                _await_end(offspring)
            _end_where(lambda process: _has_mark(process, self._mark) or _is_in(process, self.pid))
            self._has_ended = True
        code = self.wait()
        assert code is not None, "it has ended"
        return code


class Child(ChildProcess):
    """A program that this process started."""

    def __init__(
        self, command: Sequence[str], *, env: Mapping[str, str] | None = None, **arguments: Any
    ):
        _adopt_orphans()
        super().__init__(new_mark())
        environment = os.environ if env is None else env
        try:
            with _undisturbed():
                self.process: subprocess.Popen[bytes] = subprocess.Popen(
                    command,
                    env={**environment, MARK: self._mark},
                    start_new_session=True,
                    **arguments,
                )
        except OSError as error:
            raise MachineError(f"cannot start a process: {one_line(error)}") from error
        except KeyboardInterrupt:
            if hasattr(self, "process"):
                with self.process:  # closes its pipes, and waits
                    self.process.kill()
            raise
        self.pid = self.process.pid

    def wait(self, timeout_s: float | None = None) -> int | None:
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None


class AdoptedChild(ChildProcess):
    """A process that a child of this one forked, orphaned, and thereby gave to this one (Linux)."""

    def __init__(self, pid: int, mark: str):
        super().__init__(mark)
        self.pid = pid
        self._exit_code: int | None = None

    def wait(self, timeout_s: float | None = None) -> int | None:
        if sys.platform != "linux":
            raise NotImplementedError("only Linux adopts orphans")
        if self._exit_code is None:
            try:
                descriptor = os.pidfd_open(self.pid)
            except ProcessLookupError:  # killed, and waited for, with the child that forked it
                self._exit_code = -signal.SIGKILL
                return self._exit_code
            try:
                poll = select.poll()
                poll.register(descriptor, select.POLLIN)
                if not poll.poll(None if timeout_s is None else 1000 * timeout_s):
                    return None
            finally:
                os.close(descriptor)
            try:
                self._exit_code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
            except ChildProcessError:  # another thread was faster
                self._exit_code = -signal.SIGKILL if self._exit_code is None else self._exit_code
        return self._exit_code


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Delay signals until the block has ended: a process that is half started cannot be ended."""
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    waiting: list[tuple[int, FrameType | None]] = []
    has_ended = False

    def delay(number: int, frame: FrameType | None) -> None:
        if has_ended:  # a handler that raises has kept this one from being replaced
            handlers[number](number, frame)
        else:
            waiting.append((number, frame))

    if threading.current_thread() is threading.main_thread():
        for name in _DELAYED:
            number = getattr(signal, name, None)
            handler = None if number is None else signal.getsignal(number)
            if number is not None and callable(handler):
                handlers[number] = handler
                signal.signal(number, delay)
    try:
        yield
    finally:
        has_ended = True
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in waiting:
            handlers[number](number, frame)


def new_mark() -> str:
    return f"{_OWN_MARK}-{uuid.uuid4().hex}"


def end_descendants() -> None:
    """Kill all children that this process started, with what they started; for when it ends."""
    _end_where(lambda process: _has_mark(process, _OWN_MARK))


def _end_where(belongs: "Callable[[psutil.Process], bool]") -> None:
    for _ in range(_SEARCHES):
        own = [process for process in _descendants(os.getpid()) if belongs(process)]
        if not own:
            return
        _kill(own)
        _await_end(own)


def _has_mark(process: "psutil.Process", mark: str) -> bool:
    import psutil

    try:
        return process.environ().get(MARK, "").startswith(mark)
    except (psutil.Error, OSError):  # it has ended, or is another user's
        return False


def _is_in(process: "psutil.Process", session: int) -> bool:
    """Return whether a process is in a session, also where it has written over its environment."""
    try:
        return os.getsid(process.pid) == session
    except OSError:
        return False


def _descendants(pid: int) -> "list[psutil.Process]":
    """Return all descendants of a process that have not ended; none where psutil is missing."""
    try:
        import psutil
    except ImportError:
        return []
    try:
        descendants = psutil.Process(pid).children(recursive=True)
    except psutil.Error:
        return []
    return [process for process in descendants if _is_alive(process)]


def _is_alive(process: "psutil.Process") -> bool:
    import psutil

    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.Error:
        return False


def _kill(processes: "Sequence[psutil.Process]") -> None:
    for process in processes:
        with contextlib.suppress(Exception):  # it has ended, or is another user's
            process.kill()


def _await_end(processes: "Sequence[psutil.Process]") -> None:
    """Wait until killed processes have ended, and leave no zombie of those that are adopted.

    It may take a process some time to end, but not for ever: it could hang in a driver.
    """
    deadline = time.monotonic() + _DEATH_S
    while (processes := [p for p in processes if not _has_ended(p)]) and (
        time.monotonic() < deadline
    ):
        time.sleep(0.001)


def _has_ended(process: "psutil.Process") -> bool:
    try:
        return os.waitpid(process.pid, os.WNOHANG)[0] != 0
    except ChildProcessError:  # another process's child: that one collects it
        return not _is_alive(process)


def _adopt_orphans() -> None:
    """Have orphans below this process become its children (Linux).

    Without it, a process that outlives the child that started it is out of reach.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)


@contextlib.contextmanager
def adoption() -> Iterator[None]:
    """Have this process adopt orphans no longer than the block lasts, unless it did before.

    A program that goes on would not wait for orphans of its own, and they would stay as zombies.
    """
    if sys.platform != "linux":
        yield
        return
    import ctypes

    library, before = ctypes.CDLL(None), ctypes.c_int()
    is_known = library.prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(before)) == 0
    try:
        yield
    finally:
        if is_known:
            library.prctl(_PR_SET_CHILD_SUBREAPER, before.value)


def die_with_parent(parent: int | None = None) -> None:
    """Have this process end with its parent; on Linux, with the thread that started it.

    Where the parent with this process id has already ended, this process ends now.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        platforms.end_with_parent()
    if parent is not None and os.getppid() != parent:
        os._exit(1)


def ending_with_parent(command: Sequence[str]) -> list[str]:
    """Return a command that also ends with the thread that starts it, where Linux can do it.

    For programs that cannot call `die_with_parent`.
    """
    if sys.platform != "linux":
        return list(command)
    return [*_ENDING_WITH_PARENT, str(os.getpid()), *command]


def describe_exit(code: int) -> str:
    if code >= 0:
        return f"the process ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    return f"killed by signal {-code} ({name})"


def memory_bytes(pid: int) -> int:
    """Return how much memory a process occupies now; 0 if it has ended, or psutil is missing."""
    try:
        import psutil
    except ImportError:
        return 0
    try:
        return int(psutil.Process(pid).memory_info().rss)
    except psutil.Error:
        return 0


def last_line(log: Path) -> str:
    """Return the last line of a log, as the end of a sentence; empty if it has none."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - _TAIL_BYTES))
            output = file.read(_TAIL_BYTES).decode(errors="replace")
    except OSError:
        return ""
    lines = output.strip().splitlines()
    return f"; its last output: {one_line(lines[-1], 160)}" if lines else ""
