"""Programs that are workers, or fork them, in the environment of any release."""

import os
import socket
import subprocess
from collections.abc import Collection
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from mjbench.errors import writing
from mjbench.instrument import child, child_connection, platforms
from mjbench.instrument.child_connection import Process
from mjbench.paired import cores, release_python
from mjbench.paired.fork_server_process import ForkServerProcess

# Programs that wait for requests, at most: those of two sides, for the releases used last.
_MAX_SERVERS = 4
# Programs that were started early, at most: those of two sides.
_MAX_EARLY = 2


@dataclass(frozen=True)
class WorkerProgram:
    """Which program a worker is, or is forked from.

    Attributes:
      release_key: of the release in whose environment it runs.
      install: folder of the release; None for the environment of this process.
      side: 0 or 1 for baseline and candidate.
      seed: see `LaunchSeeds`.
    """

    release_key: str
    install: Path | None
    side: int
    seed: int

    def replaces(self, other: "WorkerProgram") -> bool:
        """Return whether the other one is needed no more when this one is."""
        return (self.release_key, self.side) == (other.release_key, other.side)


class WorkerPrograms:
    """Starts processes for workers: forks of a program where that is possible, else programs.

    Where the system allows it, the kernel draws no addresses for them: workers draw their own.
    """

    def __init__(self, root: Path, folder: Path, limit_s: float):
        """Start nothing yet.

        Args:
          root: a folder that `release_python.link_mjbench` filled.
          folder: in which programs run, and whose files last as long as they do.
          limit_s: seconds without an answer after which a program is killed.
        """
        self._root, self._folder, self._limit_s = root, folder, limit_s
        self._servers: dict[WorkerProgram, ForkServerProcess] = {}
        self._early: dict[WorkerProgram, ForkServerProcess] = {}
        self._retired: list[ForkServerProcess] = []
        self._server_count = 0

    def start(
        self, program: WorkerProgram, output_file: Path, allowed: Collection[int]
    ) -> tuple[Connection, Process]:
        """Start a worker, without waiting for it; return the connection to it, and its process.

        Args:
          program: that it is, or is forked from.
          output_file: for what it prints.
          allowed: cores that it may run on; none for all that this process may use.

        Raises:
          MachineError: no process can be started.
        """
        connection, theirs = child_connection.pair(self._limit_s)
        try:
            with theirs:
                return connection, self._start_worker(program, theirs, output_file, allowed)
        except BaseException:
            connection.close()
            raise

    def start_early(self, program: WorkerProgram, allowed: Collection[int]) -> None:
        """Start the program that later workers are forked from, where they are, without waiting.

        Those that were started early before, and not used, may end.

        Args:
          program: that will be used.
          allowed: cores that it may run on, for now; none for all that this process may use.

        Raises:
          MachineError: no process can be started.
        """
        if not platforms.can_adopt() or program in self._servers or program in self._early:
            return
        while len(self._early) >= _MAX_EARLY:
            self._early.pop(next(iter(self._early))).end()
        server = self._early[program] = self._new_server(program)
        cores.confine([server.process.pid], allowed or cores.USABLE)

    def _start_worker(
        self,
        program: WorkerProgram,
        theirs: socket.socket,
        output_file: Path,
        allowed: Collection[int],
    ) -> Process:
        if platforms.can_adopt():
            server = self._server(program)
            cores.confine([server.process.pid], allowed or cores.USABLE)
            return server.fork(theirs.fileno(), output_file)
        process = self._start("mjbench.paired.worker", program, theirs, output_file)
        cores.confine([process.pid], allowed or cores.USABLE)
        return process

    def end(self) -> None:
        """End all programs that fork."""
        for server in (*self._servers.values(), *self._early.values(), *self._retired):
            server.end()
        self._servers.clear()
        self._early.clear()
        self._retired.clear()

    def _server(self, program: WorkerProgram) -> ForkServerProcess:
        """Return a program that forks workers."""
        if program in self._servers and self._servers[program].has_ended:
            self._retire(program)  # its workers may go on
        if program in self._servers:
            self._servers[program] = self._servers.pop(program)  # the last one is used last
            return self._servers[program]
        for other in [other for other in self._servers if program.replaces(other)]:
            self._retire(other)
        if len(self._servers) >= _MAX_SERVERS:
            self._retire(next(iter(self._servers)))
        if program in self._early and self._early[program].has_ended:
            self._early.pop(program).end()
        server = self._early.pop(program, None) or self._new_server(program)
        self._servers[program] = server
        return server

    def _new_server(self, program: WorkerProgram) -> ForkServerProcess:
        """Start a program that forks workers."""
        self._server_count += 1
        output_file = self._folder / f"server{self._server_count}.output"
        ours, theirs = child_connection.sockets(socket.SOCK_SEQPACKET)
        with theirs:
            process = self._start("mjbench.paired.fork_server", program, theirs, output_file)
        return ForkServerProcess(process, ours, self._limit_s, output_file)

    def _retire(self, program: WorkerProgram) -> None:
        """End a server as soon as its workers have ended; it forks no others."""
        server = self._servers.pop(program)
        self._retired = [other for other in self._retired if not other.has_ended]
        self._retired.append(server)
        server.retire()

    def _start(
        self, module: str, program: WorkerProgram, theirs: socket.socket, output_file: Path
    ) -> child.Child:
        """Start `main` of a module in the environment of a release, with an inherited socket."""
        code = f"from {module} import main; main({theirs.fileno()}, {os.getpid()})"
        command = release_python.command(code, self._root, program.install)
        environment = release_python.environment(program.install)
        environment["PYTHONHASHSEED"] = str(program.seed)
        with writing(output_file):
            output = output_file.open("wb")
        with output, platforms.fixed_addresses():
            return child.Child(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                cwd=self._folder,
                env=release_python.padded(command, environment, _stack_bytes(program.seed)),
                pass_fds=[theirs.fileno()],
            )


def _stack_bytes(seed: int) -> int:
    """Return how much further down the stack begins: a multiple of 16 within a page."""
    return 16 * (seed % 256)
