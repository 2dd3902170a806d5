"""Options that several commands share, and the types of their values."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mjbench.errors import InputError

# Where run files are stored unless --results says otherwise.
RESULTS_FOLDER = Path("results/runs")


class Numbers(click.ParamType[list[int]]):
    """Comma-separated whole numbers, each at least 1."""

    name = "N,N,…"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[int]:
        """Return the numbers of a list such as `1,2,4`."""
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
        """Return the names of a list such as `rollout,mjx`."""
        if isinstance(value, list):
            return value
        names = [name.strip() for name in value.split(",") if name.strip()]
        if not names:
            self.fail("no name given", param, ctx)
        return names


class Share(click.ParamType[float]):
    """A percentage such as `1%` or `0.5`, as a share."""

    name = "PERCENT"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return a percentage as a share."""
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
        raise click.BadParameter(f"{value!r} is not a time such as 60s") from None
    if not 0 < number < float("inf"):
        raise click.BadParameter(f"{value} is not above 0")
    return number


def check_sizes(nstep: int | None, hold: int) -> None:
    """Refuse a number of steps that is not a multiple of hold.

    Raises:
      InputError: they are not.
    """
    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of --hold {hold}")


JSON = click.option(
    "--json", "json_file", metavar="FILE|-", help="Write results as JSON to FILE, or - for stdout."
)
LIMIT = click.option(
    "--time-limit",
    default=60.0,
    show_default=True,
    type=click.FloatRange(min=0.1),
    metavar="SECONDS",
    help="Kill a model's process that is silent for longer.",
)
RESULTS = click.option(
    "--results",
    default=RESULTS_FOLDER,
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=True),
    help="Folder for run files.",
)
HOLD = click.option(
    "--hold",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Steps for which each control is held.",
)
SEED = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of start states and controls.",
)
JUDGING = (
    click.option(
        "--min-effect",
        type=Share(),
        default="1%",
        show_default=True,
        help="Smallest change that matters; a change that is certainly smaller is `same`.",
    ),
    click.option(
        "--confidence",
        type=Share(),
        default="99%",
        show_default=True,
        help="Probability that a verdict is right.",
    ),
    click.option(
        "--precision",
        type=Share(),
        default="0.5%",
        show_default=True,
        help="Stop when half the interval's width is below this.",
    ),
    click.option(
        "--time-limit",
        default="60s",
        show_default=True,
        metavar="SECONDS",
        callback=seconds,
        help="Time for each verdict; after it, an uncertain one is `inconclusive`.",
    ),
)
SIZES = (
    click.option("--nbatch", type=click.IntRange(min=1), help="Simulations of a block."),
    click.option("--nstep", type=click.IntRange(min=1), help="Steps of each simulation."),
    HOLD,
    SEED,
)
