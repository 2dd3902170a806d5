"""What a command needs around its work: console, machine, JSON document, run file, interrupts."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli import interrupts
from mjbench.cli.group import command_line, report_line
from mjbench.cli.output_file import OutputFile
from mjbench.errors import InputError, printable
from mjbench.status import ExitCode, Status, exit_code

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from mjbench.host.machine import Machine, ProcessorTime
    from mjbench.host.neighbours import Neighbour, Presence
    from mjbench.report.content import DataTable, Section
    from mjbench.report.kinds import Kind
    from mjbench.store.run_file import RunFile
    from mjbench.store.runs import Record, Run, RunHeader


class ProgressBar:
    """A progress bar that shows phases alone; `terminal_progress` has the one of terminals.

    Calling it with the number of an item, what is done now, and the share of the item that is done,
    moves it.
    """

    def __call__(self, number: int, name: str, share: float) -> None:
        """Show how far the work is."""

    def begin(self, phase: str) -> None:
        """Say in a line on standard error what begins now, for who has no terminal."""
        click.echo(printable(phase), err=True)

    def show(self, results: "Callable[[], RenderableType | None] | None") -> None:
        """Show what a function returns above the bar until others replace it; None removes it."""


@dataclass(frozen=True)
class OutputOptions:
    """Where the results of a command go, as its options say.

    Attributes:
      resume: run file to continue; None to begin one.
      json_file: file for the JSON document, `-` for standard output.
    """

    results: Path
    resume: Path | None
    wait: bool
    json_file: str | None


@dataclass(frozen=True)
class Storage:
    """Where a command stores its records.

    Attributes:
      arguments: stored in the file's header; a dataclass or JSON-ready values.
      select_finished: selects the records of a continued file that are not measured again.
    """

    results: Path
    arguments: Any
    resume: Path | None = None
    select_finished: "Callable[[Sequence[Record]], Sequence[Record]]" = lambda records: records


class RunContext:
    """The frame of one command, used as a context manager.

    The JSON target and the run file are opened before the work begins, so that a folder that cannot
    be written costs nothing. From then on Ctrl-C, SIGTERM and a closed terminal end the command
    through its cleanup (see `interrupts`).

    Attributes:
      out: standard error while JSON goes to standard output.
      resumed_records: empty for a new run.
    """

    def __init__(
        self,
        command: str,
        json_file: str | None = None,
        inputs: Sequence[Path] = (),
        storage: Storage | None = None,
        wait: bool | None = None,
        to_stderr: bool = False,
    ):
        """Prepare a command.

        Args:
          json_file: file for the JSON document, `-` for standard output.
          inputs: files that the command reads, and so must not write.
          storage: None for a command without a run file.
          wait: whether to wait for another mjbench that measures here, and not to warn; None for a
            command that measures no time.
          to_stderr: whether people read standard error, because standard output is another
            program's.

        Raises:
          InputError: the JSON document would replace an input.
        """
        from mjbench.pages import terminal

        self.out: Console = terminal.console(stderr=to_stderr or json_file == "-")
        self.interrupted = False
        self.resumed_records: Sequence[Record] = ()
        self._command, self._inputs, self._storage = command, inputs, storage
        resumed = [storage.resume] if storage and storage.resume else []
        self._json = OutputFile("--json", json_file, [*inputs, *resumed])
        self._wait = wait
        self._presence: Presence | None = None
        self._run_file: RunFile | None = None
        self._header: RunHeader | None = None
        self._records: list[Record] = []
        self._machine: Machine | None = None
        self._begin: ProcessorTime | None = None

    def __enter__(self) -> "RunContext":
        """Open the outputs.

        Raises:
          InputError: the run to continue is not one of this command and this machine.
          MachineError: an output cannot be written.
        """
        from mjbench.host import machine

        interrupts.enable()
        with contextlib.ExitStack() as closing:
            closing.callback(self._json.close)
            self._json.open()
            if self._wait is not None:
                self._presence = closing.enter_context(_announced(self._command, wait=self._wait))
                self._begin = machine.ProcessorTime.now()
            if self._storage is not None:
                self._run_file = self._open_run_file(self._storage)
                closing.callback(self._run_file.close)
            self._closing = closing.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the outputs; name the run file, unless an error is on its way to the user."""
        with self._closing:
            if self._run_file is not None and error is None:
                self.out.print(f"\nRun file: {self._run_file.path}", soft_wrap=True)
            if self._presence is not None and (others := self._presence.later_neighbours()):
                from mjbench.host import neighbours

                report_line(
                    "another mjbench began to measure on this machine during this run"
                    f" ({neighbours.describe(others)}): these timings are unreliable"
                )
            if self._begin is not None and error is None:
                self._print_stolen(self._begin)

    def _print_stolen(self, begin: "ProcessorTime") -> None:
        """Say that the host gave the cores of this virtual machine to others, where it did."""
        from mjbench.host import machine

        if stolen := machine.stolen_note(begin):
            self.out.print(stolen, soft_wrap=True)

    def _open_run_file(self, storage: Storage) -> "RunFile":
        """Begin a run file, or continue one with those of its records that are finished."""
        from mjbench.report.kinds import RECORD_TYPES
        from mjbench.store import run_file, runs
        from mjbench.store.run_file import RunFile

        self._header = header = runs.RunHeader(
            runs.SCHEMA,
            self._command,
            self.machine,
            runs.to_json(storage.arguments),
            tuple(runs.InputFile.of(path) for path in dict.fromkeys(self._inputs)),
            tuple(printable(word) for word in command_line()),
            datetime.now(UTC).isoformat(timespec="seconds"),
        )
        if storage.resume is None:
            return RunFile.create(storage.results, header)
        if storage.resume.is_fifo():
            raise InputError(f"cannot continue {storage.resume}: it is a pipe, not a file")
        stored = runs.load(storage.resume, RECORD_TYPES)
        run_file.check_continues(storage.resume, stored.header, header)
        if stored.is_torn:
            report_line(f"{storage.resume}: the last line was cut short; it is left out")
        self.resumed_records = tuple(storage.select_finished(stored.records))
        self._records = [*self.resumed_records]
        return RunFile.rewrite(storage.resume, stored.header, self.resumed_records)

    @property
    def machine(self) -> "Machine":
        """The machine, described when it is first asked for."""
        from mjbench.host import machine

        if self._machine is None:
            self._machine = machine.describe()
        return self._machine

    def show(self, sections: Iterable["Section"], code: bool = False) -> None:
        """Print sections; `code`: with their snippets."""
        from mjbench.pages import terminal

        terminal.print_sections(self.out, sections, code)

    def show_results(
        self, kind: "Kind", records: "Sequence[Record] | None" = None, code: bool = False
    ) -> None:
        """Print what records come to; without any, what all of the run come to."""
        self.show(kind.sections(self._run(records)), code)

    def write_results(self, kind: "Kind") -> None:
        """Write the JSON document of all records of the run, where one was asked for."""
        self.write(kind.document(self._run()))

    def _run(self, records: "Sequence[Record] | None" = None) -> "Run":
        """Return the run as its file holds it, with all of its records or with some."""
        from mjbench.store.runs import Run

        assert self._header is not None, "this command has no run file"
        return Run(self._header, tuple(self._records if records is None else records))

    def table(self, table: "DataTable") -> None:
        """Print a table alone."""
        from mjbench.pages import terminal

        self.out.print(terminal.rich_table(table, self.out.width), soft_wrap=True)

    def record(self, record: "Record") -> None:
        """Append a record to the run file."""
        assert self._run_file is not None, "this command has no run file"
        self._run_file.append(record)
        self._records.append(record)

    def write(self, document: Any) -> None:
        """Write the command's JSON document, where one was asked for."""
        from mjbench.store.json_form import json_form

        if self._json.is_wanted:
            self._json.write(json.dumps(json_form(document), indent=1) + "\n")

    def interrupt(self) -> None:
        """Note that the user stopped the work, and tell them that results are saved."""
        self.interrupted = True
        report_line("interrupted; what was measured is saved")

    @contextlib.contextmanager
    def progress(self, count: int) -> "Iterator[ProgressBar]":
        """Yield a progress bar of `count` items; there is none unless the console is a terminal."""
        if not self.out.is_terminal:
            yield ProgressBar()
            return
        from mjbench.cli.terminal_progress import terminal_progress

        with terminal_progress(self.out, count) as bar:
            yield bar

    def exit(self, statuses: Iterable[Status]) -> None:
        """End the process with the exit code that the statuses of all rows stand for."""
        sys.exit(ExitCode.INTERRUPTED if self.interrupted else exit_code(statuses))


@contextlib.contextmanager
def _announced(command: str, wait: bool) -> Iterator["Presence"]:
    """Take part in measuring on this machine: warn of others that do, or wait for them."""
    from mjbench.host import neighbours

    with neighbours.Presence(command) as presence:
        if others := presence.enter(wait, _report_wait):
            report_line(
                f"another mjbench is measuring on this machine ({neighbours.describe(others)}):"
                " timings of both are unreliable; use --wait to start after it"
            )
        yield presence


def _report_wait(others: Sequence["Neighbour"]) -> None:
    from mjbench.host import neighbours

    report_line(f"waiting for {neighbours.describe(others)} to finish measuring")
