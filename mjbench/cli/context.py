"""What a command needs around its work: console, files, interrupts, what it measures."""

import contextlib
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjbench import extras
from mjbench.api import interrupts
from mjbench.cli import output_file
from mjbench.cli.group import command_line, option_names, report_line
from mjbench.commands.shared_options import RunFileOptions
from mjbench.errors import InputError, MachineError
from mjbench.status import ExitCode, Status, exit_code

if TYPE_CHECKING:
    from rich.console import Console

    from mjbench.commands.show.forms import Forms
    from mjbench.results.content import DataTable, Section
    from mjbench.results.runs import Record, Run
    from mjbench.session import Item, Measurement, Observer, Session

    Sections = Callable[[Run], Iterable[Section]]

CODE_HINT = "--code prints the Python code, too."


class RunContext:
    """The frame of one command, used as a context manager.

    Files that the user names and the run file are opened before the work begins, so that a folder
    that cannot be written costs nothing. From then on Ctrl-C, SIGTERM and a closed terminal end the
    command through its cleanup (see `interrupts`).

    Attributes:
      out: standard error while results go to standard output.
      files: those that the user named, by the flags of their options.
      is_stopped: whether the user stopped the work, or a record could not be stored.
    """

    def __init__(
        self,
        options: object = None,
        inputs: Sequence[Path] = (),
        session: "Session | None" = None,
        to_stderr: bool = False,
    ):
        """Prepare a command.

        Args:
          options: among them may be names of files.
          to_stderr: whether people read standard error, because standard output is another
            program's.

        Raises:
          InputError: a file cannot be used.
        """
        from mjbench.results import terminal

        self.files = output_file.of_options(options, inputs)
        on_stdout = [flag for flag, file in self.files.items() if file.is_stdout]
        if on_stdout and to_stderr:
            raise InputError(f"{on_stdout[0]} -: standard output is the program's own; name a file")
        self.out: Console = terminal.console(stderr=to_stderr or bool(on_stdout))
        self.interrupted = self.is_stopped = False
        self._session = session
        self._failures: list[Status] = []
        self._write_error: MachineError | None = None
        self._hides_code = False
        self._disturbance: str | None = None
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> "RunContext":
        """Open the outputs.

        Raises:
          InputError: the run to continue is not one of this command and this machine.
          MachineError: an output cannot be written.
        """
        interrupts.enable()
        if "--html" in self.files:
            extras.require("--html", "report", ["jinja2", "vl_convert"])
        with contextlib.ExitStack() as closing:
            for file in self.files.values():
                closing.callback(file.close)
                file.open()
            if self._session is not None:
                closing.enter_context(self._session)
            self._closing = closing.pop_all()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        """Close the outputs; name the run file, unless an error is on its way to the user.

        Ctrl-C while results are printed or written leaves them in the run file, and says so.
        """
        with self._closing:
            if self._session is None or (error is not None and not self._session.records):
                return  # nothing was measured
            if self._session.file is not None and error is None:
                self.out.print(f"\nRun file: {self._session.file}", soft_wrap=True)
            if note := self._disturbance_of(self._session):
                if error is None:
                    self.out.print(note, soft_wrap=True)
                else:
                    report_line(note)
            if isinstance(error, KeyboardInterrupt):
                self.interrupt(is_saved=self._write_error is None)
                sys.exit(ExitCode.INTERRUPTED)

    def _disturbance_of(self, session: "Session") -> str:
        """Store what disturbed the run; return it as a sentence, empty where nothing did."""
        if self._disturbance is None:
            self._disturbance = ""
            try:
                self._disturbance = session.end()
            except MachineError as error:
                self._write_error = self._write_error or error
        return self._disturbance

    @property
    def session(self) -> "Session":
        assert self._session is not None, "this command measures nothing"
        return self._session

    def take(self, item: "Item") -> None:
        """Store what was measured, or say why it could not be.

        Where it cannot be stored, the command ends once it has printed what it measured.
        """
        if item.failure is not None:
            report_line(item.failure.detail)
            self._failures.append(item.failure.status)
        try:
            for record in item.records:
                self.session.record(record)
        except MachineError as error:
            self._write_error, self.is_stopped = error, True
        if Status.INTERRUPTED in map(_status, item.records):
            self.interrupt(bool(self.session.records))

    def interrupt(self, is_saved: bool) -> None:
        """Note that the user stopped the work, and tell them whether results are saved."""
        self.interrupted = self.is_stopped = True
        saved = "; what was measured is saved" if is_saved else ""
        if is_saved and self._session is not None and "resume" in option_names():
            saved += f"; to go on, add --resume {self._session.file} to the command"
        report_line(f"interrupted{saved}")

    def show(self, sections: Iterable["Section"], code: bool = False) -> None:
        """Print sections; `code`: with their snippets."""
        from mjbench.results import terminal

        for section in sections:
            terminal.print_sections(self.out, [section], code)
            self._hides_code |= bool(section.snippets) and not (code or section.shows_code)

    def hint_at_code(self) -> None:
        """Say that there is code which was not printed, where there is."""
        if self._hides_code:
            self.out.print(CODE_HINT, soft_wrap=True)
        self._hides_code = False

    def table(self, table: "DataTable") -> None:
        from mjbench.results import terminal

        terminal.print_lines(self.out, terminal.table_parts(table, self.out.width))

    def write(self, flag: str, content: Callable[[], str]) -> None:
        """Write the file of an option, where the user named one."""
        if flag in self.files:
            self.files[flag].write(content())

    def write_json(self, document: Any) -> None:
        from mjbench.results import json_form

        self.write("--json", lambda: json_form.text(document))

    def write_forms(self, forms: "Forms") -> None:
        """Write the files of `FormOptions` that the user named."""
        self.write("--html", forms.html)
        self.write("--markdown", forms.markdown)
        self.write("--csv", forms.csv)
        self.write("--json", forms.json)

    def write_run(self) -> None:
        """Write what was measured as `mjbench show` writes its run file."""
        if self.files:
            from mjbench.commands.show import forms
            from mjbench.commands.show.reports import NamedRun

            self._disturbance_of(self.session)  # a record of the run
            file = self.session.file or Path()
            self.write_forms(forms.of_runs([NamedRun(file, self.session.run())]))

    def exit(self, statuses: Iterable[Status] | None = None) -> None:
        """End the process with the exit code that statuses, and what failed, stand for.

        Args:
          statuses: None for those of all records.
        """
        if statuses is None:
            statuses = map(_status, self.session.records)
        self.exit_with(exit_code([*statuses, *self._failures]))

    def exit_with(self, code: int) -> None:
        """End the process, with an exit code unless it was interrupted.

        Raises:
          MachineError: a record could not be stored.
        """
        if self._write_error is not None:
            raise self._write_error
        sys.exit(ExitCode.INTERRUPTED if self.interrupted else code)


def _status(record: "Record") -> Status:
    """Return how the measurement of a record ended; some are stored only if it ended well."""
    return getattr(record, "status", Status.OK)


def measure_and_print(
    measurement: "Measurement",
    output: RunFileOptions,
    *,
    each: "Sections | None" = None,
    summary: "Sections | None" = None,
    at_end: bool = False,
    code: bool | None = None,
    to_stderr: bool = False,
) -> RunContext:
    """Measure as the options of a command say; print and store what comes of it.

    Args:
      each: returns the sections of an item, printed as it comes; None for none before the end.
      summary: returns the sections of all items, printed at the end; None for none.
      at_end: where neither is given, whether the sections of the kind are of all items, rather
        than of each.
      code: whether snippets are printed, too; None for a command without that option.
    """
    from mjbench.cli.progress import progress
    from mjbench.commands.show import kinds
    from mjbench.results import runs
    from mjbench.session import Session

    if each is None and summary is None:
        each, summary = (None, _sections) if at_end else (_sections, None)
    for note in measurement.notes:
        report_line(note)
    record_types = measurement.record_types or kinds.RECORD_TYPES
    measurement = replace(measurement, record_types=record_types)
    resume = output.resume and runs.of_name(output.resume, output.results)
    session = Session(measurement, output.wait, output.results, resume, command_line(), report_line)
    inputs = [*measurement.files, *([resume] if resume else [])]
    with RunContext(output, inputs, session, to_stderr) as run:
        try:
            with (
                progress(run.out) as observer,
                contextlib.closing(measurement.measure(session.earlier, observer)) as items,
            ):
                _measure_items(run, items, observer, each, bool(code))
        except KeyboardInterrupt:
            run.interrupt(bool(session.records))
        if summary and (session.records or not run.interrupted):
            run.show(summary(session.run()))
        if code is False:
            run.hint_at_code()
        run.write_run()
    return run


def _sections(run: "Run") -> "Iterable[Section]":
    from mjbench.commands.show import kinds

    return kinds.kind_of(run).sections(run)


def _measure_items(
    run: RunContext,
    items: "Iterable[Item]",
    observer: "Observer",
    each: "Sections | None",
    code: bool,
) -> None:
    unshown: list[Record] = []

    def show() -> None:
        if each and unshown:
            run.show(each(run.session.run(unshown)), code)
        unshown.clear()

    try:
        for item in items:
            observer.show(None)
            run.take(item)
            if item.failure is None:
                unshown += item.records
            if run.is_stopped or not item.is_part:
                show()
            if run.is_stopped:
                return
    finally:  # parts of what was not measured to its end
        if unshown:
            show()
