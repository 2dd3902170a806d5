"""Processes in the environment of any release, each doing what it is asked (see worker)."""

import contextlib
import os
import pickle
import subprocess
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, one_line
from mjbench.instrument import child
from mjbench.paired import worker
from mjbench.releases import installs

_DOING = {
    "start": "importing MuJoCo",
    "load": "loading the model",
    "make": "making the workload",
    "equip": "taking the workload",
    "take": "taking the workload",
    "observe": "stepping the model",
    "prepare": "preparing a run",
    "time": "running a block",
}


class TargetError(MachineError):
    """A side crashed, hung or answered nonsense; tells which in one line."""


class WorkerProcess:
    """A worker, seen from here: it is asked for things, and answers in that order."""

    def __init__(
        self,
        connection: Connection,
        name: str,
        limit_s: float,
        process: "subprocess.Popen[bytes]",
        said: Path,
    ):
        self.connection, self.name, self.limit_s, self.pid = connection, name, limit_s, process.pid
        self._process, self._said = process, said
        self._asked: deque[str] = deque()

    def call(self, do: str, **arguments: Any) -> Any:
        """Ask for something and wait for the answer.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: it failed, crashed or did not answer in time.
        """
        self.ask(do, **arguments)
        return self.answer()

    def ask(self, do: str, **arguments: Any) -> None:
        """Ask for something small; `answer` waits for it. A second request waits for the first."""
        self._asked.append(do)
        with contextlib.suppress(OSError):  # a dead worker is told by `answer`
            self.connection.send((do, arguments))

    def answer(self) -> Any:
        """Wait for the answer to the oldest request that has none."""
        status, value = self._receive(self.connection.recv)
        self._asked.popleft()
        if status == "ok":
            return value
        kind = InputError if status == "input" else TargetError
        raise kind(f"{self.name}: {value}")

    def answers(self) -> None:
        """Wait for the answers to all requests."""
        while self._asked:
            self.answer()

    def block(self) -> int:
        """Have one block run; return its nanoseconds."""
        with contextlib.suppress(OSError):
            self.connection.send_bytes(worker.BLOCK)
        content = self._receive(self.connection.recv_bytes)
        if len(content) != worker.NANOSECONDS.size:  # the answer to `time`: it failed
            raise TargetError(f"{self.name}: {pickle.loads(content)[1]}")
        ns = int(worker.NANOSECONDS.unpack(content)[0])
        if ns <= 0:
            raise TargetError(f"{self.name}: says that a block took {ns} ns")
        return ns

    def blocks_end(self) -> None:
        """Say that there are no more blocks."""
        with contextlib.suppress(OSError):
            self.connection.send_bytes(worker.END)
        self.answer()

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self.connection.close()
        child.end_group(self._process)
        self._said.unlink(missing_ok=True)

    def _receive(self, receive: Callable[[], Any]) -> Any:
        doing = _DOING.get(self._asked[0], self._asked[0])
        if not self.connection.poll(self.limit_s):
            child.end_group(self._process)
            raise TargetError(f"{self.name}: no answer within {self.limit_s:g} s while {doing}")
        try:
            return receive()
        except (EOFError, OSError):
            how = child.cause_of_death(self._process.wait())
            said = child.last_words(child.text(self._said))
            raise TargetError(f"{self.name}: {how} while {doing}{said}") from None


class WorkerPool:
    """Starts processes in the environment of any release; ends all of them when it is left."""

    def __init__(self, limit_s: float = 60.0):
        self.limit_s = limit_s
        self._closing = contextlib.ExitStack()
        self._alive: list[WorkerProcess] = []
        self._folders: dict[str, Path | None] = {}
        self._whole: set[str] = set()
        self._files = 0

    def __enter__(self) -> "WorkerPool":
        with contextlib.ExitStack() as closing:
            self._core = closing.enter_context(child.scratch())
            worker.make_core(self._core)
            (self._core / "work").mkdir()
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._closing:  # folders and locks last until no process uses them
            self.end(list(self._alive))

    def file(self, suffix: str) -> Path:
        """Return a new path in a folder that lasts as long as this pool."""
        self._files += 1
        return self._core / "work" / f"{self._files}{suffix}"

    def keep(self, value: Any) -> Path:
        """Return a file that holds a value, for a worker to take."""
        file = self.file(".pickle")
        try:
            file.write_bytes(pickle.dumps(value))
        except OSError as error:
            raise MachineError(f"cannot write {file}: {error.strerror}") from error
        return file

    @contextlib.contextmanager
    def kept(self, value: Any) -> Iterator[Path]:
        """Yield a file that holds a value for as long as the block runs."""
        file = self.keep(value)
        try:
            yield file
        finally:
            file.unlink(missing_ok=True)

    def start(self, release: installs.ReleaseSpec, name: str = "") -> WorkerProcess:
        """Begin to start a process that imports a release; its first answer says that it did."""
        if release.key not in self._folders:
            folder = self._closing.enter_context(installs.use(release))
            self._folders[release.key] = folder
        folder, said = self._folders[release.key], self.file(".said")
        try:
            ours, child_process = self._begun(folder, said)
        except OSError as error:
            raise MachineError(f"cannot start a process: {one_line(error)}") from error
        name = name or f"MuJoCo {release.version}"
        process = WorkerProcess(ours, name, self.limit_s, child_process, said)
        self._alive.append(process)
        # the files of a release do not change while its install is in use: they are looked at once
        process.ask("start", version=release.version, files=release.key not in self._whole)
        return process

    def _begun(
        self, folder: Path | None, said: Path
    ) -> tuple[Connection, "subprocess.Popen[bytes]"]:
        ours, theirs = worker.pair()
        with theirs, said.open("wb") as out:
            theirs.set_inheritable(True)
            process = subprocess.Popen(
                worker.command(
                    f"from mjbench.paired.worker import main; main({theirs.fileno()})",
                    self._core,
                    folder,
                ),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                cwd=said.parent,
                env=worker.environment(folder),
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        return ours, process

    def started(self, process: WorkerProcess, release: installs.ReleaseSpec) -> None:
        """Wait until a process has imported its release, and has done what else it was asked."""
        process.answers()
        self._whole.add(release.key)

    def end(self, processes: Sequence[WorkerProcess]) -> None:
        """End processes of this pool."""
        for process in processes:
            process.end()
            self._alive.remove(process)


def place(processes: Sequence[WorkerProcess], cores: set[int]) -> None:
    """Have processes run on these cores only."""
    if not hasattr(os, "sched_setaffinity"):
        return
    for process in processes:
        with contextlib.suppress(OSError):  # it may have ended; `answer` tells
            os.sched_setaffinity(process.pid, cores)
