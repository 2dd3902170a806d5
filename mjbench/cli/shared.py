"""Options that several commands share, and the types of their values."""

import math
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
            share = _share(value)
        except ValueError:
            self.fail(f"{value!r} is not a percentage such as 1%", param, ctx)
        if not 0 < share < 1:
            self.fail(f"{value} is not between 0% and 100%", param, ctx)
        return share


class Shares(click.ParamType[list[float]]):
    """Comma-separated percentages such as `0,0.5%`, each at least 0, as shares."""

    name = "PERCENT,…"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[float]:
        """Return a list of percentages as shares."""
        if isinstance(value, list):
            return value
        try:
            shares = [_share(word) for word in value.split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a list of percentages such as 0,0.5,1", param, ctx)
        if not all(0 <= share < math.inf for share in shares):
            self.fail(f"{value}: each must be at least 0%, and finite", param, ctx)
        return shares


class Seconds(click.ParamType[float]):
    """A time above 0, such as `60s` or `0.5`, in seconds."""

    name = "SECONDS"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return a time in seconds."""
        try:
            seconds = float(str(value).removesuffix("s"))
        except ValueError:
            self.fail(f"{value!r} is not a time such as 60s", param, ctx)
        if not 0 < seconds < math.inf:
            self.fail(f"{value} is not above 0 and finite", param, ctx)
        return seconds


def _share(word: str) -> float:
    """Return a percentage as a share.

    Raises:
      ValueError: it is not a number.
    """
    return float(word.removesuffix("%")) / 100


def with_options(*options: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, in their order."""

    def add(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return add


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
    type=Seconds(),
    default="60s",
    show_default=True,
    help="Kill a model's process that reports nothing for this long.",
)
RESULTS = click.option(
    "--results",
    default=RESULTS_FOLDER,
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=True),
    help="Folder for run files.",
)
RESUME = click.option(
    "--resume",
    metavar="RUN",
    type=click.Path(path_type=Path),
    help="Continue this run file: what is finished in it is not measured again. The rest of the"
    " command must be as it was.",
)
WAIT = click.option(
    "--wait", is_flag=True, help="Wait until no other mjbench measures on this machine."
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
        help="Confidence of the interval: at 99%, at most 1 in 100 comparisons of identical targets"
        " is called different.",
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
        type=Seconds(),
        default="60s",
        show_default=True,
        help="Time for each verdict; after it, an uncertain one is `inconclusive`.",
    ),
)
STORING = (RESULTS, RESUME, WAIT, JSON)
SIZES = (
    click.option("--nbatch", type=click.IntRange(min=1), help="Simulations of a block."),
    click.option("--nstep", type=click.IntRange(min=1), help="Steps of each simulation."),
    HOLD,
    SEED,
)
