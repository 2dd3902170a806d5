"""Processes in the environment of any release, each doing tasks (see `worker`).

Workers are forked of programs where that is possible, and are programs else. Where the system
allows it, the kernel draws no addresses for them: workers draw their own.
"""

import contextlib
import os
import pickle
import random
import shutil
import socket
import subprocess
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from mjbench.errors import REFUSALS, Failure, writing
from mjbench.host import child, child_connection, files, machine, platforms
from mjbench.host.child_connection import ChildConnection, ChildError, Process
from mjbench.paired import cores as affinity
from mjbench.paired import memory_layout, release_python, worker_answers
from mjbench.paired.fork_server_process import ForkServerProcess
from mjbench.paired.memory_layout import LaunchSeeds
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import Done, Move
from mjbench.releases import installs, movable
from mjbench.releases.moved_install import ImmovableError, MovableInstall
from mjbench.releases.placement import Placement
from mjbench.releases.release_names import ReleaseSpec
from mjbench.status import Status

# Programs that wait for requests, at most: those of two sides, for the releases used last; and
# those among them that were started early.
_MAX_SERVERS, _MAX_EARLY = 6, 2

_P = ParamSpec("_P")
_T = TypeVar("_T")
# What a worker can be asked: a method of `Worker`, or a function of one, which runs there.
Task = Callable[Concatenate[Worker, _P], _T]
# A failure is no longer than this.
_MAX_FAILURE_BYTES = 1 << 16


class WorkerProcess:
    """A worker, seen from its parent: it does tasks in the order they were asked for."""

    def __init__(
        self,
        connection: Connection,
        name: str,
        limit_s: float,
        process: Process,
        output_file: Path,
        moved_install: Path | None = None,
    ):
        self.name, self.limit_s = name, limit_s
        self._child = ChildConnection(connection, process, output_file, name)
        self._output_file, self._moved_install = output_file, moved_install
        # What the process is doing, and what it will do next.
        self._activities: deque[str] = deque()

    @property
    def pid(self) -> int:
        return self._child.process.pid

    def call(self, task: Task[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Have a task done and return its answer; no other task may be pending.

        Raises:
          InputError: what was asked for cannot be.
          ChildError: the process failed, crashed or did not answer in time.
        """
        self.ask(task, *args, **kwargs)
        answer: _T = self._answer()
        return answer

    def ask(self, task: Task[_P, Any], *args: _P.args, **kwargs: _P.kwargs) -> None:
        """Ask for a task with small arguments, without waiting for its answer."""
        self._activities.append(task.__dict__["activity"])
        with contextlib.suppress(OSError):  # a dead worker is reported when its answer is read
            self._child.connection.send((task, args, kwargs))

    def wait(self) -> None:
        """Wait for the answers to all pending tasks; raise what `call` does."""
        while self._activities:
            self._answer()

    def is_ready(self) -> bool:
        """Return whether all tasks are done, without waiting for one; raise what `call` does."""
        while self._activities and self._child.connection.poll():
            self._answer()
        return not self._activities

    def count_cores(self, nthread: int) -> float | None:
        """Return how many cores threads get in it now; None of one thread, which has its own."""
        nthread = affinity.countable(nthread)
        return self.call(Worker.count_cores, nthread) if nthread > 1 else None

    def time_block(self) -> int:
        """Have one block run, after `Worker.time_blocks` was asked; return its nanoseconds."""
        with contextlib.suppress(OSError):
            self._child.connection.send_bytes(worker_answers.BLOCK)
        activity, size = self._activities[0], worker_answers.NANOSECONDS.size
        content = self._child.receive(self.limit_s, activity, size + _MAX_FAILURE_BYTES)
        if len(content) != size:  # the block failed, and ended the task
            raise self._failed(self._child.unpickled(content, activity, Failure).detail)
        ns = int(worker_answers.NANOSECONDS.unpack(content)[0])
        if ns <= 0:
            raise self._failed(f"reports that a block took {ns} ns")
        return ns

    def end_blocks(self) -> None:
        with contextlib.suppress(OSError):
            self._child.connection.send_bytes(worker_answers.END)
        self._answer()

    def end(self) -> None:
        self._child.end()
        self._output_file.unlink(missing_ok=True)
        if self._moved_install is not None:
            shutil.rmtree(self._moved_install, ignore_errors=True)

    def _answer(self) -> Any:
        activity = self._activities[0]
        content = self._child.receive(self.limit_s, activity, machine.available_memory_bytes())
        answer: Done[Any] | Failure = self._child.unpickled(content, activity, Done, Failure)
        self._activities.popleft()
        if isinstance(answer, Done):
            return answer.value
        if kind := REFUSALS.get(answer.status):
            raise kind(f"{self.name}: {answer.detail}")
        raise self._failed(answer.detail)

    def _failed(self, cause: str) -> ChildError:
        return ChildError(Status.FAILED, cause, name=self.name)


@dataclass(frozen=True)
class _Program:
    """What a worker is, or is forked from; `side` is 0 or 1 for baseline and candidate."""

    release: ReleaseSpec
    side: int
    seed: int


class WorkerPool:
    """Starts processes in the environment of any release, and ends all of them when it closes.

    Attributes:
      limit_s: seconds without an answer after which a process is killed.
      immovable: why releases cannot be moved, by their key (see `moved_check`).
    """

    def __init__(self, limit_s: float = 60.0):
        self.limit_s = limit_s
        self.immovable: dict[str, ImmovableError] = {}
        self._closing = contextlib.ExitStack()
        self._processes: list[WorkerProcess] = []
        # The one used last is the last.
        self._servers: dict[_Program, ForkServerProcess] = {}
        self._retired: list[ForkServerProcess] = []
        # By the key of a release: its install, what moves in it, and the file that holds that.
        self._installs: dict[str, Path | None] = {}
        self._movable: dict[str, MovableInstall] = {}
        self._moves: dict[str, tuple[Path, Path]] = {}
        # Releases whose files were checked. They cannot change while the install is in use.
        self._checked: set[str] = set()
        self._file_count = 0
        self._seeds = LaunchSeeds(0, 0)
        # Of launches, by the keys of their two releases.
        self._schedules: dict[tuple[str, str], Iterator[LaunchSeeds]] = {}

    def __enter__(self) -> "WorkerPool":
        with contextlib.ExitStack() as closing:
            self._root = closing.enter_context(files.temporary_folder())
            self._work = self._root / "work"
            with writing(self._root):
                release_python.link_mjbench(self._root)
                self._work.mkdir()
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._closing:  # folders and locks last until no process uses them
            self.end(list(self._processes))
            for server in (*self._servers.values(), *self._retired):
                server.end()

    def new_file(self, suffix: str) -> Path:
        self._file_count += 1
        return self._work / f"{self._file_count}{suffix}"

    def new_folder(self) -> Path:
        folder = self.new_file("")
        with writing(folder):
            folder.mkdir()
        return folder

    def forbids_programs(self) -> bool:
        """Return whether no library can be loaded from this pool's files (mount option noexec)."""
        return platforms.forbids_programs(self._work)

    def save(self, value: Any) -> Path:
        """Pickle a value to a new file, for a worker to read; return the file."""
        file = self.new_file(".pickle")
        with writing(file):
            file.write_bytes(pickle.dumps(value))
        return file

    @contextlib.contextmanager
    def saved(self, value: Any) -> Iterator[Path]:
        file = self.save(value)
        try:
            yield file
        finally:
            file.unlink(missing_ok=True)

    def start(
        self,
        release: ReleaseSpec,
        name: str = "",
        placement: Placement | None = None,
        side: int = 0,
        cores: Collection[int] = (),
        seeds: LaunchSeeds | None = None,
    ) -> WorkerProcess:
        """Start a process that imports a release, without waiting for it (see `wait_for`).

        Args:
          placement: of the release's libraries; None for as shipped.
          side: 0 or 1 for baseline and candidate, which are never forked from one program.
          cores: that it may run on, for now; none for all that this process may use.
          seeds: of the launch that it is of; None for those used last.

        Raises:
          ImmovableError: its libraries cannot be moved.
        """
        self._install(release)
        output_file = self.new_file(".output")
        move = None
        if placement is not None:
            movable_file, others = self._movable_files(release)
            move = Move(movable_file, others, self.new_file(".moved"), placement)
        self._seeds = seeds or self._seeds
        program = _Program(release, side, self._seeds.program)
        connection, theirs = child_connection.pair(self.limit_s)
        try:
            with theirs:
                process = self._start_worker(program, theirs, output_file, cores)
        except BaseException:
            connection.close()
            raise
        name = name or f"MuJoCo {release.version}"
        moved_install = move.folder if move else None
        worker = WorkerProcess(connection, name, self.limit_s, process, output_file, moved_install)
        self._processes.append(worker)
        check_files = release.key not in self._checked
        worker.ask(Worker.start_release, release.version, check_files, self._seeds.memory, move)
        return worker

    def seeds(self, releases: tuple[ReleaseSpec, ReleaseSpec]) -> Iterator[LaunchSeeds]:
        """Return the seeds of the next launches of two releases.

        Programs that fork their workers are always started for both at the same time. Comparisons
        of the same two releases, one after the other, share them: to start a program takes as long
        as a launch.
        """
        keys = releases[0].key, releases[1].key
        if keys not in self._schedules:
            launches = memory_layout.launches_of_a_program()
            self._schedules[keys] = memory_layout.schedule(random.Random(), launches)
        return self._schedules[keys]

    def start_program_early(
        self, release: ReleaseSpec, side: int, cores: Collection[int], seeds: LaunchSeeds
    ) -> None:
        """Start the program that workers of a later launch are forked from, where they are forked.

        Those that were started early before, and not used, may end.
        """
        program = _Program(release, side, seeds.program)
        if not platforms.can_adopt() or program in self._servers:
            return
        self._install(release)
        early = [each for each, server in self._servers.items() if not server.has_forked]
        if len(early) >= _MAX_EARLY:
            self._retire(early[0])
        self._server(program, cores)

    def movable(self, release: ReleaseSpec) -> MovableInstall:
        """Return what moves in a release; it is installed first if it is missing.

        Raises:
          ImmovableError: its libraries cannot be moved.
        """
        if release.key not in self._movable:
            site = movable.site_folder(self._install(release))
            self._movable[release.key] = movable.read(site)
        return self._movable[release.key]

    def wait_for(self, process: WorkerProcess, release: ReleaseSpec) -> None:
        """Wait until a process has imported its release and done all other tasks."""
        process.wait()
        self._checked.add(release.key)

    @contextlib.contextmanager
    def ready(self, release: ReleaseSpec, name: str = "") -> Iterator[WorkerProcess]:
        """Yield a process that has imported a release; it ends with the block."""
        process = self.start(release, name)
        try:
            self.wait_for(process, release)
            yield process
        finally:
            self.end([process])

    def end(self, processes: Sequence[WorkerProcess]) -> None:
        """End processes of this pool, all of them even where ending one is interrupted."""
        with contextlib.ExitStack() as ending:
            for process in processes:
                ending.callback(self._end, process)

    def _end(self, process: WorkerProcess) -> None:
        process.end()
        if process in self._processes:
            self._processes.remove(process)

    def _install(self, release: ReleaseSpec) -> Path | None:
        if release.key not in self._installs:
            self._installs[release.key] = self._closing.enter_context(installs.use(release))
        return self._installs[release.key]

    def _movable_files(self, release: ReleaseSpec) -> tuple[Path, Path]:
        if release.key not in self._moves:
            install, others = self.movable(release), self.new_file(".others")
            with writing(others):
                install.link_others(others)
            self._moves[release.key] = self.save(install), others
        return self._moves[release.key]

    def _start_worker(
        self, program: _Program, theirs: socket.socket, output_file: Path, cores: Collection[int]
    ) -> Process:
        if not platforms.can_adopt():
            process = self._start_program("mjbench.paired.worker", program, theirs, output_file)
            affinity.confine([process.pid], cores or affinity.USABLE)
            return process
        used = [each for each, server in self._servers.items() if server.has_forked]
        for other in used:
            if other != program and (other.release, other.side) == (program.release, program.side):
                self._retire(other)
        return self._server(program, cores).fork(theirs.fileno(), output_file)

    def _server(self, program: _Program, cores: Collection[int]) -> ForkServerProcess:
        """Return a program that forks workers, which start on some cores."""
        if program in self._servers and self._servers[program].has_ended:
            self._retire(program)  # its workers may go on
        server = self._servers.pop(program, None)
        if server is None:
            if len(self._servers) >= _MAX_SERVERS:
                self._retire(next(iter(self._servers)))
            output_file = self.new_file(".server")
            ours, theirs = child_connection.sockets(socket.SOCK_SEQPACKET)
            with theirs:
                module = "mjbench.paired.fork_server"
                process = self._start_program(module, program, theirs, output_file)
            server = ForkServerProcess(process, ours, self.limit_s, output_file)
        self._servers[program] = server
        affinity.confine([server.process.pid], cores or affinity.USABLE)
        return server

    def _retire(self, program: _Program) -> None:
        """End a server as soon as its workers have ended; it forks no others."""
        server = self._servers.pop(program)
        self._retired = [other for other in self._retired if not other.has_ended]
        self._retired.append(server)
        server.retire()

    def _start_program(
        self, module: str, program: _Program, theirs: socket.socket, output_file: Path
    ) -> child.Child:
        """Start `main` of a module in the environment of a release, with an inherited socket."""
        code = f"from {module} import main; main({theirs.fileno()}, {os.getpid()})"
        install = self._install(program.release)
        command = release_python.command(code, self._root, install)
        environment = release_python.environment(install)
        environment["PYTHONHASHSEED"] = str(program.seed)
        # how much further down the stack begins: a multiple of 16 within a page
        stack_bytes = 16 * (program.seed % 256)
        with writing(output_file), output_file.open("wb") as output, platforms.fixed_addresses():
            return child.Child(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                cwd=self._work,
                env=release_python.padded(command, environment, stack_bytes),
                pass_fds=[theirs.fileno()],
            )
