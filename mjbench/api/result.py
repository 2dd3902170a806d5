"""What a measurement in a program returns: a value that prints what the command prints."""

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from mjbench.api.interrupts import one_interrupt
from mjbench.commands.show import kinds, reports, rows
from mjbench.commands.show.reports import NamedRun
from mjbench.commands.show.rows import Cell
from mjbench.errors import REFUSALS, MachineError, one_line
from mjbench.host import child, platforms
from mjbench.host.machine import Machine
from mjbench.measuring.timing import Progress
from mjbench.results import markdown, terminal
from mjbench.results.content import Report
from mjbench.results.json_form import json_form
from mjbench.results.run_writer import RunFile
from mjbench.results.runs import Run
from mjbench.session import Item, Measurement, Observer, Session
from mjbench.status import Status

# The longest conclusion in the one line of `repr`.
_REPR_CHARACTERS = 200


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """Records of a measurement; all else is derived from them, as the commands do.

    `print` shows what the command prints; a notebook shows conclusions and tables.

    Attributes:
      run: what a run file would hold: the machine, and the records with all raw samples that the
        command would store.
      notes: what makes timings unreliable on this system, a sentence each; usually none.
    """

    run: Run
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        measurement: Measurement,
        wait: bool | None = False,
        on_progress: Progress | None = None,
    ) -> Self:
        """Measure, and return the records; the first Ctrl-C interrupts.

        Raises:
          InputError: nothing could be measured, because of the input.
          MachineError: nothing could be measured, or this operating system cannot do it.
          KeyboardInterrupt: no child process is left.
        """
        platforms.check_command(measurement.command)
        measured: list[Item] = []
        with (
            _in_program(),
            Session(measurement, wait) as session,
            _observer(on_progress) as observer,
            contextlib.closing(measurement.measure((), observer)) as items,
        ):
            for item in items:
                for record in item.records:
                    session.record(record)
                    if getattr(record, "status", None) == Status.INTERRUPTED:
                        raise KeyboardInterrupt
                measured.append(item)
            _check_any(measured)
            session.end()
            return cls(session.run(), tuple(measurement.notes))

    @property
    def machine(self) -> Machine:
        return self.run.header.machine

    def save(self, folder: str | Path = "results/runs") -> Path:
        """Write a run file, which `mjbench show` reads; return its path.

        Args:
          folder: for the file, which is named by time and command.

        Raises:
          MachineError: it cannot be written.
        """
        file = RunFile.create(Path(folder), self.run.header)
        try:
            for record in self.run.records:
                file.append(record)
        finally:
            file.close()
        return file.path

    def rows(self) -> list[dict[str, Cell]]:
        """Return the results as flat dictionaries, for `pandas.DataFrame`; see `mjbench.load`."""
        return rows.of_run(self.run)

    def to_dict(self) -> Any:
        return json_form(kinds.kind_of(self.run).document(self.run))

    def report(self) -> Report:
        """Return the content of a report: conclusions, tables, and the data of charts."""
        file = Path(f"{self.run.header.command}.jsonl")
        return reports.build([NamedRun(file, self.run)])

    def __str__(self) -> str:
        sections = kinds.kind_of(self.run).sections(self.run)
        return "\n".join([terminal.text_of(sections), *self.notes])

    def __repr__(self) -> str:
        conclusions = [conclusion.text for conclusion in self.report().conclusions[:1]]
        text = one_line("; ".join(conclusions), _REPR_CHARACTERS)
        return f"<mjbench {type(self).__name__}: {text}>"

    def _repr_markdown_(self) -> str:
        return "\n".join(markdown.brief(self.report(), self.notes))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # IPython in a terminal
        printer.text("…" if cycle else str(self))


class _CellLine(Observer):
    """Shows in a line below the cell of a notebook what is measured now."""

    def __init__(self, display: Any):
        """Take IPython's function that displays something."""
        super().__init__()
        self._line = display({"text/plain": ""}, raw=True, display_id=True)
        self._text = ""

    def __call__(self, name: str, share: float) -> None:
        self.begin(f"{name} ({100 * share:.0f} %)")

    def begin(self, phase: str) -> None:
        if phase != self._text:
            self._text = phase
            self._line.update({"text/plain": phase}, raw=True)


@contextlib.contextmanager
def _observer(on_progress: Progress | None) -> Iterator[Observer]:
    """Yield what is told of progress: a function, in a notebook a line until the end, or nobody."""
    ipython: Any = sys.modules.get("IPython")
    is_notebook = ipython is not None and hasattr(ipython.get_ipython(), "kernel")
    if on_progress is not None or not is_notebook:
        yield Observer(on_progress)
        return
    line = _CellLine(ipython.display.display)
    try:
        yield line
    finally:
        line.begin("")


@contextlib.contextmanager
def _in_program() -> Iterator[None]:
    """Let the first Ctrl-C interrupt, and leave no child process in the program."""
    with one_interrupt(), child.adoption():
        try:
            yield
        except KeyboardInterrupt:
            child.end_descendants()
            raise


def _check_any(items: Sequence[Item]) -> None:
    """Refuse items of which none was measured; the first record of an item says how it ended.

    Raises:
      InputError: the first model's cause is its input.
      MachineError: it is something else.
    """
    records: list[Any] = [item.records[0] for item in items]
    if any(record.status == Status.OK for record in records):
        return
    first, failure = records[0], items[0].failure
    kind = REFUSALS.get(first.status, MachineError)
    if failure is not None:
        raise kind(failure.detail)
    detail = first.detail.removeprefix(f"{first.model}: ")
    raise kind(f"{first.model}: {detail or first.status}")
