"""The progress bar of terminals, with the results so far above it."""

import contextlib
from collections.abc import Callable, Iterable, Iterator

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from mjbench.cli.context import ProgressBar


class _ProgressWithResults(Progress):
    """A progress bar with something above it."""

    results: RenderableType | None = None

    def get_renderables(self) -> Iterable[RenderableType]:
        if self.results is not None:
            yield self.results
        yield from super().get_renderables()


class _TerminalBar(ProgressBar):
    """A progress bar in a terminal."""

    def __init__(self, progress: _ProgressWithResults, count: int):
        self._progress = progress
        self._task = progress.add_task("starting", total=count)

    def __call__(self, number: int, name: str, share: float) -> None:
        self._progress.update(self._task, completed=number + share, description=name, refresh=True)

    def begin(self, phase: str) -> None:
        """Say nothing more: the bar names what is done."""

    def show(self, results: Callable[[], RenderableType | None] | None) -> None:
        self._progress.results = results() if results else None
        self._progress.refresh()


@contextlib.contextmanager
def terminal_progress(out: Console, count: int) -> Iterator[ProgressBar]:
    """Yield a progress bar of `count` items, which is gone at the end."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # no refresh thread: it would take time from the blocks being timed
    with _ProgressWithResults(*columns, console=out, auto_refresh=False, transient=True) as bar:
        yield _TerminalBar(bar, count)
