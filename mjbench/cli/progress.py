"""The progress bar of terminals, with the results so far above it."""

import contextlib
from collections.abc import Callable, Iterator

import click
from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from mjbench.api.session import Observer
from mjbench.errors import printable
from mjbench.pages import terminal
from mjbench.report.content import Section


class PhaseLines(Observer):
    """Says in lines on standard error what begins, for who has no terminal."""

    def begin(self, phase: str) -> None:
        """Say what begins now."""
        click.echo(printable(phase), err=True)


class _TerminalBar(Observer):
    """A progress bar in a terminal, which names what is done."""

    def __init__(self, live: Live, bar: Progress):
        super().__init__()
        self._live, self._bar = live, bar
        self._task = bar.add_task("starting", total=1.0)

    def __call__(self, name: str, share: float) -> None:
        self._bar.update(self._task, completed=share, description=name)
        self._live.start()  # the first time; until then a program may print
        self._live.refresh()

    def show(self, section: Callable[[], Section | None] | None) -> None:
        so_far = section() if section else None
        parts = terminal.section_parts(so_far, self._live.console.width) if so_far else ()
        self._live.update(Group(*parts, self._bar), refresh=True)


@contextlib.contextmanager
def progress(out: Console) -> Iterator[Observer]:
    """Yield what shows progress: a bar, which is gone at the end, or lines."""
    if not out.is_terminal:
        yield PhaseLines()
        return
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=out,
        auto_refresh=False,
    )
    # no refresh thread: it would take time from the blocks being timed
    live = Live(bar, console=out, auto_refresh=False, transient=True)
    with contextlib.ExitStack() as closing:
        closing.callback(live.stop)
        yield _TerminalBar(live, bar)
