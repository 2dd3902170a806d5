"""The progress bar of terminals, with the results so far above it."""

import contextlib
import logging
from collections.abc import Callable, Iterator

import click
from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Column

from mjbench.cli.group import report_line
from mjbench.errors import printable
from mjbench.results import terminal
from mjbench.results.content import Section
from mjbench.session import Observer


class PhaseLines(Observer):
    """Says in lines on standard error what begins; without a terminal."""

    def begin(self, phase: str) -> None:
        """Say what begins now."""
        click.echo(printable(phase), err=True)


class _TerminalBar(Observer):
    def __init__(self, live: Live, bar: Progress):
        super().__init__()
        self._live, self._bar = live, bar
        self._task = bar.add_task("starting", total=1.0)

    def __call__(self, name: str, share: float) -> None:
        self._bar.update(self._task, completed=share, description=name)
        self._live.start()  # the first time; until then a program may print
        self._live.refresh()

    def begin(self, phase: str) -> None:
        self(phase, self._bar.tasks[0].completed)

    def go_on(self, phase: str) -> None:
        self.begin(phase)

    def show(self, section: Callable[[], Section | None] | None) -> None:
        so_far = section() if section else None
        parts = terminal.section_parts(so_far, self._live.console.width) if so_far else ()
        self._live.update(Group(*parts, self._bar), refresh=True)
        if section is None:
            self._live.stop()  # what others print begins a line


class _Phases(logging.Handler):
    """Shows what mjbench logs: a phase, such as an install, as progress, a warning as a line.

    For debugging it logs how far a phase is, which a bar shows, too.
    """

    def __init__(self, observer: Observer):
        super().__init__(logging.DEBUG)
        self._observer = observer

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno > logging.INFO:
            report_line(record.getMessage().removeprefix("mjbench: "))
        elif record.levelno == logging.INFO:
            self._observer.begin(record.getMessage())
        else:
            self._observer.go_on(record.getMessage())


@contextlib.contextmanager
def _logged_to(observer: Observer) -> Iterator[Observer]:
    logger, handler = logging.getLogger("mjbench"), _Phases(observer)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    try:
        yield observer
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


@contextlib.contextmanager
def progress(out: Console) -> Iterator[Observer]:
    """Yield what shows progress: a bar, which is gone at the end, or lines."""
    if not out.is_terminal or out.is_dumb_terminal:
        with _logged_to(PhaseLines()) as observer:
            yield observer
        return
    name_column = Column(no_wrap=True, ratio=1)  # what does not fit is cut here, and not in times
    bar = Progress(
        TextColumn("{task.description}", markup=False, table_column=name_column),
        BarColumn(bar_width=12),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=out,
        auto_refresh=False,
        expand=True,
    )
    # no refresh thread: it would take time from the blocks being timed
    live = Live(bar, console=out, auto_refresh=False, transient=True)
    with contextlib.ExitStack() as closing:
        closing.callback(live.stop)
        yield closing.enter_context(_logged_to(_TerminalBar(live, bar)))
