"""What surrounds a measurement in a program: interrupts, other measurements, the host's share."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from mjbench.host import child, machine, neighbours, platforms
from mjbench.host.machine import ProcessorTime
from mjbench.host.neighbours import Neighbour, Presence
from mjbench.store import runs
from mjbench.store.runs import Record, Run

# Seconds that the cleanup may take before a further Ctrl-C interrupts it.
CLEANUP_S = 10.0


class Session:
    """The time in which a program measures; used as a context manager.

    While it lasts, the first Ctrl-C raises KeyboardInterrupt, and the cleanup that follows is not
    disturbed by further ones.
    """

    def __init__(self, command: str, wait: bool = False):
        """Prepare to measure.

        Args:
          wait: whether to wait until no other mjbench measures on this machine.

        Raises:
          MachineError: this operating system cannot do it.
        """
        platforms.check_command(command)
        self._command, self._wait = command, wait
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> "Session":
        """Begin to measure."""
        with contextlib.ExitStack() as closing:
            closing.enter_context(one_interrupt())
            closing.enter_context(child.adoption())
            self._presence = closing.enter_context(Presence(self._command))
            self._others: Sequence[Neighbour] = self._presence.enter(self._wait)
            self._machine = machine.describe()
            self._began = datetime.now(UTC).isoformat(timespec="seconds")
            self._processor_time = ProcessorTime.now()
            self._closing = closing.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop measuring; end processes that were interrupted as they started."""
        with self._closing:
            if isinstance(error, KeyboardInterrupt):
                child.end_descendants()

    def run(
        self,
        records: Sequence[Record],
        arguments: Mapping[str, Any],
        files: Sequence[Path] = (),
    ) -> Run:
        """Return what was measured, as a run file would hold it."""
        header = runs.RunHeader(
            runs.SCHEMA,
            self._command,
            self._machine,
            runs.to_json(dict(arguments)),
            tuple(runs.InputFile.of(path) for path in dict.fromkeys(files)),
            began=self._began,
        )
        return Run(header, tuple(records))

    def notes(self) -> tuple[str, ...]:
        """Return what made timings unreliable until now, a sentence each."""
        others = {(each.pid, each.command): each for each in self._others}
        others |= {(each.pid, each.command): each for each in self._presence.later_neighbours()}
        notes = []
        if others:
            notes.append(
                "Another mjbench measured on this machine at the same time"
                f" ({neighbours.describe(list(others.values()))}): these timings are unreliable."
            )
        if stolen := machine.stolen_note(self._processor_time):
            notes.append(stolen)
        return tuple(notes)


@contextlib.contextmanager
def one_interrupt(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Let the first Ctrl-C interrupt the block; further ones do not disturb its cleanup.

    A handler of the program's own stays in place. In another thread than the main one nothing
    changes: Ctrl-C does not reach it.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    first_s: float | None = None

    def handle(signum: int, frame: FrameType | None) -> None:
        nonlocal first_s
        now = clock()
        if first_s is not None and now - first_s <= CLEANUP_S:
            return
        first_s = now
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
