"""A fork server (see `fork_server`), seen from its parent."""

import contextlib
import shutil
import socket
import time
from collections.abc import Callable
from pathlib import Path

from mjbench.errors import MachineError, one_line, writing
from mjbench.host import child
from mjbench.paired import fork_server


class ForkedWorker:
    """A worker that a fork server was asked for; its process id is awaited when it is needed.

    Attributes:
      mark: that what it starts has in its environment (`child.MARK`).
      is_awaited: whether its server has not said yet that it forked it, and may still do so.
    """

    def __init__(
        self, server: "ForkServerProcess", mark: str, output_file: Path, deadline_s: float
    ):
        self.mark, self.output_file, self.deadline_s = mark, output_file, deadline_s
        self._server, self.is_awaited = server, True
        self._process: child.AdoptedChild | None = None

    @property
    def pid(self) -> int:
        """Its process id, or the server's if that ended before it forked."""
        self._server.await_fork(self)
        return self._process.pid if self._process else self._server.process.pid

    def adopt(self, pid: int) -> None:
        self._process = child.AdoptedChild(pid, self.mark)
        self.is_awaited = False

    def wait(self, timeout_s: float | None = None) -> int | None:
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
    """A program that forks workers of one release."""

    def __init__(
        self,
        process: child.Child,
        control: socket.socket,
        limit_s: float,
        output_file: Path,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Take over a server; `control` keeps messages apart."""
        self.process, self.has_forked = process, False
        self._control, self._output_file = control, output_file
        self._limit_s, self._clock = limit_s, clock
        self._is_retired = False
        self._workers: dict[str, ForkedWorker] = {}  # by mark

    @property
    def has_ended(self) -> bool:
        return self.process.wait(0.0) is not None

    def fork(self, connection: int, output_file: Path) -> ForkedWorker:
        """Ask for a worker, without waiting for it."""
        self.has_forked = True
        mark = child.new_mark()
        worker = ForkedWorker(self, mark, output_file, self._clock() + self._limit_s)
        with writing(output_file):
            output = output_file.open("wb")
        self._workers[mark] = worker  # first, so that an answer is known whatever interrupts this
        try:
            with output:
                self._control.settimeout(self._limit_s)
                socket.send_fds(self._control, [mark.encode()], [connection, output.fileno()])
        except OSError as error:
            del self._workers[mark]
            raise MachineError(f"cannot start a process: {one_line(error)}") from error
        return worker

    def await_fork(self, worker: ForkedWorker) -> None:
        while worker.is_awaited:
            self._receive(worker.deadline_s)

    def _receive(self, deadline_s: float) -> None:
        """Receive one answer, which may be about another worker.

        An answer is only removed once it was taken into account, or Ctrl-C in between would lose
        it.
        """
        size = fork_server.PID.size
        answer = b""
        with contextlib.suppress(OSError):
            self._control.settimeout(max(deadline_s - self._clock(), 0.0))
            answer = self._control.recv(size + fork_server.MAX_MARK_BYTES, socket.MSG_PEEK)
        if not answer:
            self.process.end()
            self._give_up()
            return
        worker = self._workers.get(answer[size:].decode())
        if worker is not None and worker.is_awaited:
            worker.adopt(*fork_server.PID.unpack(answer[:size]))
        self._control.recv(len(answer))

    def _give_up(self) -> None:
        """Note that no other worker will be forked, and leave them the reason as their output."""
        for worker in self._workers.values():
            if worker.is_awaited:
                worker.is_awaited = False
                with contextlib.suppress(OSError):
                    shutil.copyfile(self._output_file, worker.output_file)

    def forget(self, worker: ForkedWorker) -> None:
        """Note that a worker has ended; the last one of a retired server ends the server."""
        self._workers.pop(worker.mark, None)
        if self._is_retired:
            self.retire()

    def retire(self) -> None:
        """End the server as soon as all of its workers have ended."""
        self._is_retired = True
        if not self._workers:
            self.end()

    def end(self) -> None:
        self._control.close()
        self.process.end()
        self._output_file.unlink(missing_ok=True)
