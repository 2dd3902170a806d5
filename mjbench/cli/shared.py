"""What several commands share: types of options, options, output, exit codes."""

import contextlib
import json
import signal
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import click

from mjbench.errors import InputError, MachineError
from mjbench.instrument.runs import FOLDER

INTERRUPTED = 130


class Numbers(click.ParamType[list[int]]):
    """Comma-separated whole numbers, each at least 1."""

    name = "N,N,…"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[int]:
        """Return the numbers that a word stands for."""
        if isinstance(value, list):
            return value
        try:
            numbers = [int(word) for word in value.split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a list of whole numbers such as 1,2,4", param, ctx)
        if min(numbers) < 1:
            self.fail(f"{min(numbers)} is below 1", param, ctx)
        return list(dict.fromkeys(numbers))


class Names(click.ParamType[list[str]]):
    """Comma-separated names."""

    name = "NAME,…"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[str]:
        """Return the names that a word lists."""
        if isinstance(value, list):
            return value
        names = [name.strip() for name in value.split(",") if name.strip()]
        if not names:
            self.fail("names nothing", param, ctx)
        return names


class Share(click.ParamType[float]):
    """A percentage such as `1%` or `0.5`, as a share."""

    name = "PERCENT"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the share that a percentage stands for."""
        if isinstance(value, float):
            return value
        try:
            share = float(str(value).removesuffix("%")) / 100
        except ValueError:
            self.fail(f"{value!r} is not a percentage such as 1%", param, ctx)
        if not 0 < share < 1:
            self.fail(f"{value} is not between 0% and 100%", param, ctx)
        return share


def with_options(*options: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, in their order."""

    def add(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def seconds(ctx: click.Context, param: click.Parameter, value: str) -> float:
    """Return a time such as `60s` in seconds."""
    try:
        number = float(value.removesuffix("s"))
    except ValueError:
        raise click.BadParameter(f"{value!r} is no time such as 60s") from None
    if not 0 < number < float("inf"):
        raise click.BadParameter(f"{value} is not above 0")
    return number


def check_sizes(nstep: int | None, hold: int) -> None:
    """Refuse steps that are not whole holds.

    Raises:
      InputError: they are not.
    """
    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of --hold {hold}")


def exit_code(statuses: Iterable[str]) -> int:
    """Return what a command ends with, from how its rows ended."""
    found = set(statuses)
    if "disagrees" in found:
        return 1
    if found & {"crashed", "timeout", "failed"}:
        return 3
    return 2 if "input" in found else 0


JSON = click.option(
    "--json", "json_file", metavar="FILE|-", help="Write results as JSON to FILE, or - for stdout."
)
LIMIT = click.option(
    "--time-limit",
    default=60.0,
    show_default=True,
    type=click.FloatRange(min=0.1),
    metavar="SECONDS",
    help="Kill a model's process when it is silent for longer.",
)
RESULTS = click.option(
    "--results",
    default=FOLDER,
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=True),
    help="Where run files are kept.",
)
HOLD = click.option(
    "--hold",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Steps that each control is held.",
)
SEED = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Decides start states and controls.",
)
JUDGING = (
    click.option(
        "--min-effect",
        type=Share(),
        default="1%",
        show_default=True,
        help="Smallest change that matters; what is surely within it is `same`.",
    ),
    click.option(
        "--confidence",
        type=Share(),
        default="99%",
        show_default=True,
        help="That a verdict is right.",
    ),
    click.option(
        "--precision",
        type=Share(),
        default="0.5%",
        show_default=True,
        help="Stop when the interval is this narrow (half of its width).",
    ),
    click.option(
        "--time-limit",
        default="60s",
        show_default=True,
        metavar="SECONDS",
        callback=seconds,
        help="Of launches, for each verdict; after it, `inconclusive` if it is not certain.",
    ),
)
SIZES = (
    click.option("--nbatch", type=click.IntRange(min=1), help="Simulations of a block."),
    click.option("--nstep", type=click.IntRange(min=1), help="Steps of each simulation."),
    HOLD,
    SEED,
)


@contextlib.contextmanager
def output(name: str | None) -> Iterator[Callable[[Any], None]]:
    """Yield a function that writes a document; the target is opened before the work begins.

    From here on there is something to save: signals end the command by way of its cleaning up.
    """
    interruptible()
    if name is None:
        yield lambda document: None
        return
    if name == "-":
        yield lambda document: click.echo(json.dumps(document, indent=1))
        return
    file = Path(name)
    with _writing(name):
        file.write_text("", encoding="utf-8")

    def write(document: Any) -> None:
        with _writing(name):
            file.write_text(json.dumps(document, indent=1), encoding="utf-8")

    yield write


@contextlib.contextmanager
def _writing(name: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise MachineError(f"cannot write {name}: {error.strerror}") from error


@contextlib.contextmanager
def progress(out: Any, count: int) -> Iterator[Callable[[int, str, float], None]]:
    """Yield a function that moves a progress bar; there is none unless `out` is a terminal."""
    if not out.is_terminal:
        yield lambda number, name, share: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    # no refreshing thread: it would take time from the blocks being timed
    with Progress(*columns, console=out, auto_refresh=False, transient=True) as bar:
        task = bar.add_task("starting", total=count)

        def advance(number: int, name: str, share: float) -> None:
            bar.update(task, completed=number + share, description=name, refresh=True)

        yield advance


def interruptible() -> None:
    """Have signals end the command by way of its cleaning up."""
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt
