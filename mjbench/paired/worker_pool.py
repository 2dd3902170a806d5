"""Processes in the environment of any release, each answering requests (see `requests`)."""

import contextlib
import os
import pickle
import shutil
import socket
import struct
import subprocess
from collections import deque
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from mjbench.errors import Failure, InputError, MachineError, one_line, writing
from mjbench.instrument import child, machine, platforms
from mjbench.paired import release_python, requests
from mjbench.paired.requests import Request
from mjbench.releases import installs, movable
from mjbench.releases.moved_install import MovableInstall
from mjbench.releases.placement import Placement
from mjbench.status import Status

_T = TypeVar("_T")
# A worker that has closed its connection has ended, or does within this many seconds.
_EXIT_S = 5.0
# A failure is no longer than this.
_MAX_FAILURE_BYTES = 1 << 16


class TargetError(MachineError):
    """A target's process crashed, hung or failed; the message names the target in one line."""


class WorkerProcess:
    """A worker, seen from its parent: it answers requests in the order they were sent.

    Attributes:
      connection: to the worker.
      name: for error messages, such as `baseline (MuJoCo 4.0.0, cartpole)`.
      limit_s: seconds without an answer after which the process is killed.
      pid: of the process.
    """

    def __init__(
        self,
        connection: Connection,
        name: str,
        limit_s: float,
        process: child.Child,
        output_file: Path,
        moved_install: Path | None = None,
    ):
        self.connection, self.name, self.limit_s = connection, name, limit_s
        self.pid = process.process.pid
        self._process, self._output_file = process, output_file
        self._moved_install = moved_install
        self._pending: deque[Request[Any]] = deque()

    def call(self, request: Request[_T]) -> _T:
        """Send a request and return its answer; no other request may be pending.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: the process failed, crashed or did not answer in time.
        """
        self.ask(request)
        answer: _T = self._answer()
        return answer

    def ask(self, request: Request[Any]) -> None:
        """Send a small request, without waiting for its answer."""
        self._pending.append(request)
        with contextlib.suppress(OSError):  # a dead worker is reported when its answer is read
            self.connection.send(request)

    def wait(self) -> None:
        """Wait for the answers to all pending requests.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: the process failed, crashed or did not answer in time.
        """
        while self._pending:
            self._answer()

    def is_ready(self) -> bool:
        """Return whether all requests are answered, without waiting for one.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: the process failed or crashed.
        """
        while self._pending and self.connection.poll():
            self._answer()
        return not self._pending

    def time_block(self) -> int:
        """Have one block run, after `TimeBlocks` was asked; return its nanoseconds.

        Raises:
          TargetError: the process failed, crashed or did not answer in time.
        """
        with contextlib.suppress(OSError):
            self.connection.send_bytes(requests.BLOCK)
        content = self._receive(requests.NANOSECONDS.size + _MAX_FAILURE_BYTES)
        if len(content) != requests.NANOSECONDS.size:  # the block failed, and ended `TimeBlocks`
            raise TargetError(f"{self.name}: {self._unpickled(content, Failure).detail}")
        ns = int(requests.NANOSECONDS.unpack(content)[0])
        if ns <= 0:
            raise TargetError(f"{self.name}: reports that a block took {ns} ns")
        return ns

    def end_blocks(self) -> None:
        """End `TimeBlocks`."""
        with contextlib.suppress(OSError):
            self.connection.send_bytes(requests.END)
        self._answer()

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self.connection.close()
        self._process.end()
        self._output_file.unlink(missing_ok=True)
        if self._moved_install is not None:
            shutil.rmtree(self._moved_install, ignore_errors=True)

    def _answer(self) -> Any:
        """Return the answer to the oldest pending request."""
        content = self._receive(machine.available_memory_bytes())
        answer: requests.Done[Any] | Failure = self._unpickled(content, requests.Done, Failure)
        self._pending.popleft()
        if isinstance(answer, requests.Done):
            return answer.value
        kind = InputError if answer.status == Status.INPUT else TargetError
        raise kind(f"{self.name}: {answer.detail}")

    def _receive(self, max_bytes: int) -> bytes:
        """Return the bytes of the next answer, `max_bytes` at most."""
        activity = self._pending[0].activity
        if not self.connection.poll(self.limit_s):
            self._process.end()
            raise TargetError(f"{self.name}: no answer within {self.limit_s:g} s while {activity}")
        try:
            return self.connection.recv_bytes(max_bytes)
        except (EOFError, OSError):
            cause = self._describe_end()
            output = child.last_line(self._output_file)
            raise TargetError(f"{self.name}: {cause} while {activity}{output}") from None

    def _describe_end(self) -> str:
        """Describe how the process ended; one that goes on sent an answer that is too long."""
        try:
            return child.describe_exit(self._process.process.wait(_EXIT_S))
        except subprocess.TimeoutExpired:
            self._process.end()
            return "sent an invalid answer, killed"

    def _unpickled(self, content: bytes, *kinds: type) -> Any:
        """Return the answer that bytes stand for.

        Raises:
          TargetError: they stand for nothing of these kinds.
        """
        try:
            answer = pickle.loads(content)
        except Exception as error:  # damaged bytes raise whatever they spell
            answer = error
        if not isinstance(answer, kinds):
            self._process.end()
            activity = self._pending[0].activity
            raise TargetError(
                f"{self.name}: sent an invalid answer, killed while {activity}"
                f" ({one_line(repr(content[:20]))})"
            )
        return answer


class WorkerPool:
    """Starts processes in the environment of any release, and ends all of them when it closes.

    Used as a context manager.

    Attributes:
      limit_s: seconds without an answer after which a process is killed.
    """

    def __init__(self, limit_s: float = 60.0):
        self.limit_s = limit_s
        self._closing = contextlib.ExitStack()
        self._processes: list[WorkerProcess] = []
        # By the key of a release: its install, what moves in it, and the file that holds that.
        self._installs: dict[str, Path | None] = {}
        self._movable: dict[str, MovableInstall] = {}
        self._movable_files: dict[str, Path] = {}
        # Releases whose files were checked. They cannot change while the install is in use.
        self._checked: set[str] = set()
        self._file_count = 0

    def __enter__(self) -> "WorkerPool":
        with contextlib.ExitStack() as closing:
            self._core = closing.enter_context(child.scratch())
            self._work = self._core / "work"
            with writing(self._core):
                release_python.link_mjbench(self._core)
                self._work.mkdir()
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._closing:  # folders and locks last until no process uses them
            self.end(list(self._processes))

    def new_file(self, suffix: str) -> Path:
        """Return a new path in a folder that lasts as long as this pool."""
        self._file_count += 1
        return self._work / f"{self._file_count}{suffix}"

    def forbids_programs(self) -> bool:
        """Return whether no library can be loaded from this pool's files (mount option noexec)."""
        return platforms.forbids_programs(self._work)

    def save(self, value: Any) -> Path:
        """Pickle a value to a new file, for a worker to read; return the file.

        Raises:
          MachineError: it cannot be written.
        """
        file = self.new_file(".pickle")
        with writing(file):
            file.write_bytes(pickle.dumps(value))
        return file

    @contextlib.contextmanager
    def saved(self, value: Any) -> Iterator[Path]:
        """Yield a file that holds a pickled value for as long as the block runs."""
        file = self.save(value)
        try:
            yield file
        finally:
            file.unlink(missing_ok=True)

    def start(
        self,
        release: installs.ReleaseSpec,
        name: str = "",
        placement: Placement | None = None,
    ) -> WorkerProcess:
        """Start a process that imports a release, without waiting for it (see `wait_for`).

        Args:
          release: of MuJoCo; installed first if it is missing.
          name: of the process, for error messages.
          placement: of the release's libraries; None for as shipped.

        Raises:
          InputError: there is no such release.
          MachineError: it cannot be installed, or no process can be started.
          ImmovableError: its libraries cannot be moved.
        """
        install, output_file = self._install(release), self.new_file(".output")
        move = None
        if placement is not None:
            movable_file = self._movable_file(release)
            move = requests.Move(movable_file, self.new_file(".moved"), placement)
        connection, process = self._spawn(install, output_file)
        name = name or f"MuJoCo {release.version}"
        moved_install = move.folder if move else None
        worker = WorkerProcess(connection, name, self.limit_s, process, output_file, moved_install)
        self._processes.append(worker)
        check_files = release.key not in self._checked
        worker.ask(requests.StartRelease(release.version, check_files, move))
        return worker

    def movable(self, release: installs.ReleaseSpec) -> MovableInstall:
        """Return what moves in a release; it is installed first if it is missing.

        Raises:
          InputError: there is no such release.
          MachineError: it cannot be installed.
          ImmovableError: its libraries cannot be moved.
        """
        if release.key not in self._movable:
            site = movable.site_folder(self._install(release))
            self._movable[release.key] = movable.read(site)
        return self._movable[release.key]

    def wait_for(self, process: WorkerProcess, release: installs.ReleaseSpec) -> None:
        """Wait until a process has imported its release and answered all other requests.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: it failed, crashed or did not answer in time.
        """
        process.wait()
        self._checked.add(release.key)

    def end(self, processes: Sequence[WorkerProcess]) -> None:
        """End processes of this pool."""
        for process in processes:
            process.end()
            self._processes.remove(process)

    def _install(self, release: installs.ReleaseSpec) -> Path | None:
        """Return the folder of a release's install, which lasts as long as this pool."""
        if release.key not in self._installs:
            install = self._closing.enter_context(installs.use(release))
            self._installs[release.key] = install
        return self._installs[release.key]

    def _movable_file(self, release: installs.ReleaseSpec) -> Path:
        """Return the file that holds what moves in a release."""
        if release.key not in self._movable_files:
            self._movable_files[release.key] = self.save(self.movable(release))
        return self._movable_files[release.key]

    def _spawn(self, install: Path | None, output_file: Path) -> tuple[Connection, child.Child]:
        try:
            parent, worker = socket.socketpair()
        except OSError as error:
            raise MachineError(f"cannot start a process: {one_line(error)}") from error
        # of an answer that has begun; `poll` waits for its beginning
        parent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(self.limit_s))
        connection = Connection(parent.detach())
        with worker, writing(output_file), output_file.open("wb") as output:
            main = f"main({worker.fileno()}, {os.getpid()})"
            process = child.Child(
                release_python.command(
                    f"from mjbench.paired.worker import main; {main}", self._core, install
                ),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                cwd=self._work,
                env=release_python.environment(install),
                pass_fds=[worker.fileno()],
            )
        return connection, process


def _timeval(seconds: float) -> bytes:
    """Return a time as the `struct timeval` of C."""
    whole = int(seconds)
    return struct.pack("@ll", whole, int(1e6 * (seconds - whole)))
