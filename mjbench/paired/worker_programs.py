"""Programs that are workers, or fork them, in the environment of any release."""

import os
import socket
import struct
import subprocess
from collections.abc import Collection
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import BinaryIO

from mjbench.errors import MachineError, one_line, writing
from mjbench.instrument import child, platforms
from mjbench.paired import cores, release_python
from mjbench.paired.fork_server_process import MAX_FORKS, ForkServerProcess
from mjbench.paired.worker_process import Process

# Programs that wait for requests, at most: a comparison has four, of two releases and two series.
_MAX_SERVERS = 4


@dataclass(frozen=True)
class ReleaseEnvironment:
    """Where the code of a release comes from.

    Attributes:
      key: of the release.
      install: its folder; None for the environment of this process.
    """

    key: str
    install: Path | None


class WorkerPrograms:
    """Starts processes for workers: forks of a program where that is possible, else programs."""

    def __init__(self, core: Path, folder: Path, limit_s: float):
        """Start nothing yet.

        Args:
          core: a folder that `release_python.link_mjbench` filled.
          folder: in which programs run, and whose files last as long as they do.
          limit_s: seconds without an answer after which a program is killed.
        """
        self._core, self._folder, self._limit_s = core, folder, limit_s
        self._servers: dict[tuple[str, int], ForkServerProcess] = {}
        self._replaced: set[tuple[str, int]] = set()
        self._retired: list[ForkServerProcess] = []
        self._server_count = 0

    def start(
        self,
        environment: ReleaseEnvironment,
        output_file: Path,
        series: int,
        allowed: Collection[int],
    ) -> tuple[Connection, Process]:
        """Start a worker, without waiting for it; return the connection to it, and its process.

        Args:
          environment: of the release.
          output_file: for what it prints.
          series: see `WorkerPool.start`.
          allowed: cores that it may run on; none for all that this process may use.

        Raises:
          MachineError: no process can be started.
        """
        ours, theirs = _socket_pair(socket.SOCK_STREAM)
        # of an answer that has begun; `poll` waits for its beginning
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(self._limit_s))
        connection = Connection(ours.detach())
        process: Process
        with theirs, writing(output_file), output_file.open("wb") as output:
            if platforms.can_adopt():
                key = environment.key, series
                server = self._server(environment, series, allowed)
                process = server.fork(theirs.fileno(), output.fileno())
                if server.is_used_up:
                    self._retire(key)
                    self._replaced.add(key)
                    self._server(environment, series, allowed)  # the next one is ready in time
            else:
                process = self._start("mjbench.paired.worker", environment, theirs, output)
                cores.confine([process.pid], allowed or cores.USABLE)
        return connection, process

    def end(self) -> None:
        """End all programs that fork."""
        for server in (*self._servers.values(), *self._retired):
            server.end()
        self._servers.clear()
        self._retired.clear()

    def _server(
        self, environment: ReleaseEnvironment, series: int, allowed: Collection[int]
    ) -> ForkServerProcess:
        """Return the program that forks the next worker of a series, kept on some cores."""
        key = environment.key, series
        if key in self._servers and self._servers[key].has_ended:
            self._servers.pop(key).end()
        if key in self._servers:
            self._servers[key] = self._servers.pop(key)  # the last one is the one used last
        else:
            if len(self._servers) >= _MAX_SERVERS:
                self._retire(next(iter(self._servers)))
            self._server_count += 1
            output_file = self._folder / f"server{self._server_count}.output"
            ours, theirs = _socket_pair(socket.SOCK_SEQPACKET)
            with theirs, writing(output_file), output_file.open("wb") as output:
                program = self._start("mjbench.paired.fork_server", environment, theirs, output)
            # the servers of two series are replaced in turns, rather than at the same time
            max_forks = MAX_FORKS if key in self._replaced else MAX_FORKS - series % 2
            self._servers[key] = ForkServerProcess(
                program, ours, self._limit_s, output_file, max_forks
            )
        server = self._servers[key]
        cores.confine([server.process.pid], allowed or cores.USABLE)
        return server

    def _retire(self, key: tuple[str, int]) -> None:
        """End a server as soon as its workers have ended; no other worker comes of it."""
        server = self._servers.pop(key)
        self._retired = [other for other in self._retired if not other.has_ended]
        self._retired.append(server)
        server.retire()

    def _start(
        self, module: str, environment: ReleaseEnvironment, theirs: socket.socket, output: BinaryIO
    ) -> child.Child:
        """Start `main` of a module in the environment of a release, with an inherited socket."""
        code = f"from {module} import main; main({theirs.fileno()}, {os.getpid()})"
        return child.Child(
            release_python.command(code, self._core, environment.install),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            cwd=self._folder,
            env=release_python.environment(environment.install),
            pass_fds=[theirs.fileno()],
        )


def _socket_pair(kind: int) -> tuple[socket.socket, socket.socket]:
    """Return a connected pair of sockets.

    Raises:
      MachineError: the system has none left.
    """
    try:
        return socket.socketpair(type=kind)
    except OSError as error:
        raise MachineError(f"cannot start a process: {one_line(error)}") from error


def _timeval(seconds: float) -> bytes:
    """Return a time as the `struct timeval` of C."""
    whole = int(seconds)
    return struct.pack("@ll", whole, int(1e6 * (seconds - whole)))
