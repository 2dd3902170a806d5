"""A fork server (see `fork_server`), seen from its parent."""

import contextlib
import socket
from collections import deque
from pathlib import Path

from mjbench.errors import MachineError, one_line
from mjbench.instrument import child
from mjbench.paired import fork_server


class ForkedWorker:
    """A worker that a fork server was asked for; nothing waits for it until it must be known."""

    def __init__(self, server: "ForkServerProcess", mark: str):
        self._server, self._mark = server, mark
        self._process: child.AdoptedChild | None = None

    @property
    def pid(self) -> int:
        """Its process id, or the server's if that ended before it forked."""
        self._server.await_fork(self)
        return self._process.pid if self._process else self._server.process.pid

    def adopt(self, pid: int) -> None:
        """Note that it was forked, and has become a child of this process."""
        self._process = child.AdoptedChild(pid, self._mark)

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Wait until it has ended (see `child.ChildProcess.wait`)."""
        self._server.await_fork(self)
        process = self._process or self._server.process
        return process.wait(timeout_s)

    def end(self) -> None:
        """Kill it with everything that it started."""
        self._server.await_fork(self)
        if self._process is not None:
            self._process.end()
        self._server.forget(self)


class ForkServerProcess:
    """A program that forks workers of one release.

    Attributes:
      process: the program itself.
    """

    def __init__(
        self, process: child.Child, control: socket.socket, limit_s: float, output_file: Path
    ):
        """Take over a server.

        Args:
          process: the program.
          control: to the program; it keeps messages apart.
          limit_s: seconds without an answer after which the program is killed.
          output_file: of the program.
        """
        self.process = process
        self._control, self._output_file = control, output_file
        self._control.settimeout(limit_s)
        self._is_retired = False
        self._pending: deque[ForkedWorker] = deque()
        self._workers: set[ForkedWorker] = set()

    @property
    def has_ended(self) -> bool:
        """Whether the program has ended, by itself or because it was killed."""
        return self.process.wait(0.0) is not None

    def fork(self, connection: int, output: int) -> ForkedWorker:
        """Ask for a worker, without waiting for it.

        Args:
          connection: descriptor of the worker's end of its connection.
          output: descriptor of the file for what it prints.

        Raises:
          MachineError: the server has ended.
        """
        mark = child.new_mark()
        worker = ForkedWorker(self, mark)
        try:
            socket.send_fds(self._control, [mark.encode()], [connection, output])
        except OSError as error:
            raise MachineError(f"cannot start a process: {one_line(error)}") from error
        self._pending.append(worker)
        self._workers.add(worker)
        return worker

    def await_fork(self, worker: ForkedWorker) -> None:
        """Wait until it is known whether a worker was forked."""
        while worker in self._pending:
            answer = b""
            with contextlib.suppress(OSError):
                answer = self._control.recv(fork_server.PID.size)
            if len(answer) == fork_server.PID.size:
                self._pending.popleft().adopt(*fork_server.PID.unpack(answer))
            else:
                self._pending.clear()
                self.process.end()

    def forget(self, worker: ForkedWorker) -> None:
        """Note that a worker has ended; the last one of a retired server ends the server."""
        self._workers.discard(worker)
        if self._is_retired and not self._workers:
            self.end()

    def retire(self) -> None:
        """End the server as soon as all of its workers have ended."""
        self._is_retired = True
        if not self._workers:
            self.end()

    def end(self) -> None:
        """End the server, and its workers."""
        self._control.close()
        self.process.end()
        self._output_file.unlink(missing_ok=True)
