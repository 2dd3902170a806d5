"""Processes in the environment of any release, each doing tasks (see `worker`).

Workers are forked of programs where that is possible, and are programs else. Where the system
allows it, the kernel draws no addresses for them: workers draw their own. `ProcessPairs` starts two
for each launch of a comparison, those of the next launch while one is measured.
"""

import contextlib
import itertools
import os
import pickle
import random
import socket
import subprocess
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mjbench.errors import MjbenchError, writing
from mjbench.host import child, child_connection, files, machine, platforms
from mjbench.host.child_connection import Process
from mjbench.paired import cores as affinity
from mjbench.paired import memory_layout, release_python
from mjbench.paired.fork_server_process import ForkServerProcess
from mjbench.paired.memory_layout import LaunchSeeds
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import Move
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases import installs, movable
from mjbench.releases.moved_install import ImmovableError, MovableInstall
from mjbench.releases.placement import AS_SHIPPED, Placement, PlacementPair
from mjbench.releases.release_names import ReleaseSpec

# Programs that wait for requests, at most: those of two sides, for the releases used last; and
# those among them that were started early.
_MAX_SERVERS, _MAX_EARLY = 6, 2

# Asks new processes, of the baseline and the candidate, for what a launch needs, without waiting.
Equip = Callable[[Sequence[WorkerProcess]], None]


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
        self,
        program: _Program,
        theirs: socket.socket,
        output_file: Path,
        cores: Collection[int],
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


@dataclass(frozen=True, eq=False)
class ProcessPair:
    """The processes of one launch, and the core that they are measured on; None for all."""

    processes: tuple[WorkerProcess, WorkerProcess]
    placements: PlacementPair
    core: int | None = None


class ProcessPairs:
    """Starts two processes for each launch, one in each of two releases.

    A process that fails raises its error in `wait`, so that it does not end the launches before its
    own.
    """

    def __init__(
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        placements: Iterator[PlacementPair] | None = None,
    ):
        """Start the processes of the first launch; `equip` tells all of them what they need."""
        self._pool, self._releases, self._names = pool, releases, names
        self._placements = placements or itertools.repeat(AS_SHIPPED)
        self._seeds = pool.seeds(releases)
        self._next_seeds = next(self._seeds)
        self._equip: Equip | None = None
        # Those that were started ahead, for the next launch.
        self._next: ProcessPair | None = None
        # Those whose launches are over, and which are ended while the next ones start.
        self._finished: list[ProcessPair] = []
        self._failure: MjbenchError | None = None
        try:
            self._start_ahead(affinity.USABLE)
        except BaseException:
            self.close()
            raise

    def equip(self, equip: Equip) -> None:
        """Have the processes of every launch asked for what they need, the next one's now."""
        self._equip = equip
        if self._next is not None:
            equip(self._next.processes)

    def wait(self) -> None:
        """Wait until the processes of the next launch are ready."""
        try:
            if self._failure is not None:
                raise self._failure
            next_pair = self._start_ahead(affinity.USABLE)
            for process, release in zip(next_pair.processes, self._releases, strict=True):
                self._pool.wait_for(process, release)
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def launch(self, core: int | None) -> Iterator[ProcessPair]:
        """Yield the processes of a launch, which must be ready, with this thread on their core.

        The processes of the next launch start on other cores meanwhile. Ask nothing of the
        processes of this launch after the block: they are ended now or later.

        Args:
          core: that the launch is measured on; None for all of them, where nothing else may run.
        """
        assert self._next is not None, "`wait` has started them"
        pair, self._next = self._next, None
        others = affinity.beside(core) if core is not None and machine.usable_cores() > 1 else ()
        try:
            ahead = self._start_ahead(others) if others else None
            self._end_finished()
            with affinity.pinned(core):
                yield replace(pair, core=core)
            if ahead is not None:
                affinity.confine([process.pid for process in ahead.processes], affinity.USABLE)
        finally:
            self._finished.append(pair)
            if not others:  # nothing starts meanwhile, and what comes next may need all memory
                self._end_finished()

    def is_next_ready(self) -> bool:
        """Return whether nothing is started ahead that is still starting."""
        try:
            return (
                self._failure is not None
                or self._next is None
                or all(process.is_ready() for process in self._next.processes)
            )
        except MjbenchError as error:
            self._failure = error
            return True

    def close(self) -> None:
        if self._next is not None:
            self._finished.append(self._next)
        self._next, self._failure = None, None
        self._end_finished()

    def _end_finished(self) -> None:
        pairs, self._finished = self._finished, []
        self._pool.end([process for pair in pairs for process in pair.processes])

    def _start_ahead(self, allowed: Collection[int]) -> ProcessPair:
        """Return the processes of the next launch; start them if need be, without waiting."""
        if self._next is not None:
            return self._next
        seeds, self._next_seeds = self._next_seeds, next(self._seeds)
        placements = next(self._placements)
        both = (placements.old, placements.new)
        started: dict[int, WorkerProcess] = {}
        try:
            for i in random.sample((0, 1), 2):  # neither of the two is always the first
                started[i] = self._pool.start(
                    self._releases[i], self._names[i], both[i], i, allowed, seeds
                )
            pair = ProcessPair((started[0], started[1]), placements)
            if self._equip is not None:
                self._equip(pair.processes)
            if self._next_seeds.program != seeds.program:
                for i in random.sample((0, 1), 2):
                    release = self._releases[i]
                    self._pool.start_program_early(release, i, allowed, self._next_seeds)
        except BaseException:
            self._pool.end(list(started.values()))
            raise
        self._next = pair
        return pair
