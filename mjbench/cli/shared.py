"""Options that several commands share, and the types of their values."""

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.errors import InputError, one_line
from mjbench.limits import (
    MAX_COUNT,
    MAX_HERTZ,
    MAX_LARGE_COUNT,
    MAX_SECONDS,
    MAX_SEED,
    TIME_LIMIT_S,
)
from mjbench.paired import outcomes

if TYPE_CHECKING:
    from mjbench.simulation.starts import StartPlan

# Where run files are stored unless --results says otherwise.
RESULTS_FOLDER = Path("results/runs")
# The largest slowdown to inject, as a share of the time of a block.
MAX_SLOWDOWN = 10.0


class Numbers(click.ParamType[list[int]]):
    """Comma-separated whole numbers, each at least 1 and at most `most`."""

    name = "N,N,…"

    def __init__(self, most: int = MAX_COUNT) -> None:
        self.most = most

    def convert(self, value: Any, param: Any, ctx: Any) -> list[int]:
        """Return the numbers of a list such as `1,2,4`, each once."""
        if isinstance(value, list):
            return value
        try:
            numbers = [int(word) for word in value.split(",")]
        except ValueError:
            self.fail(f"{_quoted(value)} is not a list of whole numbers such as 1,2,4", param, ctx)
        if min(numbers) < 1:
            self.fail(f"{one_line(min(numbers), 30)} is below 1", param, ctx)
        if max(numbers) > self.most:
            self.fail(f"{one_line(max(numbers), 30)} is above {self.most}", param, ctx)
        return list(dict.fromkeys(numbers))


class LargeCount(click.ParamType[int]):
    """A whole number, also written as `1e9`."""

    name = "N"

    def convert(self, value: Any, param: Any, ctx: Any) -> int:
        """Return the number."""
        if isinstance(value, int):
            return value
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not 1 <= number <= MAX_LARGE_COUNT or number != int(number):
            self.fail(
                f"{_quoted(value)} is not a whole number from 1 to {MAX_LARGE_COUNT:.0e}, such as"
                " 1000000 or 1e9",
                param,
                ctx,
            )
        return int(number)


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
    """A percentage such as `1%` or `0.5`, as a share above 0 and below `below`."""

    name = "PERCENT"

    def __init__(self, below: float = 1.0) -> None:
        self.below = below

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return a percentage as a share."""
        if isinstance(value, float):
            return value
        try:
            share = _share(value)
        except ValueError:
            self.fail(f"{_quoted(value)} is not a percentage such as 1%", param, ctx)
        if not 0 < share < self.below:
            self.fail(f"{_quoted(value)} is not between 0% and {100 * self.below:g}%", param, ctx)
        return share


class Shares(click.ParamType[list[float]]):
    """Comma-separated percentages such as `0,0.5%`, as shares from 0 to `most`."""

    name = "PERCENT,…"

    def __init__(self, most: float = MAX_SLOWDOWN) -> None:
        self.most = most

    def convert(self, value: Any, param: Any, ctx: Any) -> list[float]:
        """Return a list of percentages as shares, each once."""
        if isinstance(value, list):
            return value
        try:
            shares = [_share(word) for word in value.split(",")]
        except ValueError:
            self.fail(f"{_quoted(value)} is not a list of percentages such as 0,0.5,1", param, ctx)
        if not all(0 <= share <= self.most for share in shares):
            self.fail(f"{_quoted(value)}: each must be from 0% to {100 * self.most:g}%", param, ctx)
        return list(dict.fromkeys(abs(share) for share in shares))  # abs: -0 is 0


# By how a time ends; longer endings first.
_SECONDS_PER = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "s": 1.0}


class Seconds(click.ParamType[float]):
    """A time such as `60s`, `1ms` or `0.5`, in seconds; at most a day, above 0 unless `zero`."""

    name = "SECONDS"

    def __init__(self, zero: bool = False) -> None:
        self.zero = zero

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return a time in seconds."""
        text = str(value).strip()
        unit = next((unit for unit in _SECONDS_PER if text.endswith(unit)), "")
        try:
            seconds = float(text.removesuffix(unit)) * _SECONDS_PER.get(unit, 1.0)
        except ValueError:
            self.fail(f"{_quoted(value)} is not a time such as 60s", param, ctx)
        if not (0 < seconds <= MAX_SECONDS or (self.zero and seconds == 0)):
            least = "at least 0" if self.zero else "above 0"
            self.fail(
                f"{_quoted(value)} is not {least} and at most {MAX_SECONDS:.0f}s, a day", param, ctx
            )
        return abs(seconds)  # -0 is 0


class Hertz(click.ParamType[float]):
    """A number of times per second, such as `1000` or `500Hz`: above 0 and at most a million."""

    name = "HZ"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the times per second."""
        try:
            rate = float(str(value).strip().removesuffix("Hz"))
        except ValueError:
            rate = math.nan
        if not 0 < rate <= MAX_HERTZ:
            self.fail(
                f"{_quoted(value)} is not a number of times per second, such as 1000, of at most"
                f" {MAX_HERTZ:,.0f}",
                param,
                ctx,
            )
        return rate


def _share(word: str) -> float:
    """Return a percentage as a share."""
    return float(word.strip().removesuffix("%")) / 100


def _quoted(value: object) -> str:
    """Return what the user wrote in quotes, on one line, cut short where it is long."""
    return one_line(repr(value), 60)


def own_path_folder(path_names: Sequence[str] | None) -> str | None:
    """Return the folder that the user's own paths are imported from, and import from it here, too.

    Returns:
      The current folder; None where no path is the user's own.
    """
    if not any(":" in name for name in path_names or ()):
        return None
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    return folder


def with_options(*options: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, in their order."""

    def add(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def check_sizes(nstep: int | None, hold: int) -> None:
    """Refuse a number of steps that is not a multiple of hold."""
    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of --hold {hold}")


def start_plan(
    settle_s: float | None, states_file: Path | None, actions_file: Path | None = None
) -> "StartPlan":
    """Return the plan that the options STARTS ask for.

    Raises:
      InputError: both --settle and --states are given, or there is no such file of arrays.
    """
    from mjbench.simulation import starts

    return starts.start_plan(settle_s, states_file, actions_file)


COUNT = click.IntRange(1, MAX_COUNT)
SEED_NUMBER = click.IntRange(0, MAX_SEED)
JSON = click.option(
    "--json", "json_file", metavar="FILE|-", help="Write results as JSON to FILE, or - for stdout."
)
PAGE = click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Write the page to FILE  [default: stdout]",
)
LIMIT = click.option(
    "--time-limit",
    type=Seconds(),
    default=f"{TIME_LIMIT_S:g}s",
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
CODE = click.option(
    "--code", is_flag=True, help="Print the Python code, too, such as that of advised paths."
)
CODE_HINT = "--code prints the Python code, too."
HOLD = click.option(
    "--hold",
    type=COUNT,
    default=1,
    show_default=True,
    help="Steps for which each control is held: an environment's frame_skip.",
)
SEED = click.option(
    "--seed",
    type=SEED_NUMBER,
    default=0,
    show_default=True,
    help="Seed of start states and controls.",
)
JUDGING = (
    click.option(
        "--min-effect",
        type=Share(),
        default=f"{100 * outcomes.MIN_EFFECT:g}%",
        show_default=True,
        help="Smallest change that matters; a change that is certainly smaller is `same`.",
    ),
    click.option(
        "--confidence",
        type=Share(),
        default=f"{100 * outcomes.CONFIDENCE:g}%",
        show_default=True,
        help="Confidence of the interval: at 99%, at most 1 in 100 comparisons of identical targets"
        " is called different.",
    ),
    click.option(
        "--precision",
        type=Share(),
        default=f"{100 * outcomes.PRECISION:g}%",
        show_default=True,
        help="Stop when half the interval's width is below this.",
    ),
    click.option(
        "--time-limit",
        type=Seconds(),
        default=f"{outcomes.TIME_LIMIT_S:g}s",
        show_default=True,
        help="Time for each verdict, once the models are loaded; after it, an uncertain one is"
        " `inconclusive`.",
    ),
    click.option(
        "--as-shipped",
        is_flag=True,
        help="Compare builds with their machine code where it lies in memory. By default mjbench"
        " moves it from launch to launch, so that only what the code does makes a difference.",
    ),
)
STORING = (RESULTS, RESUME, WAIT, JSON)
STATES = click.option(
    "--states",
    "states_file",
    metavar="FILE.npz",
    type=click.Path(path_type=Path),
    help="Draw start states, and their controls if there are any, from this file, which"
    " `mjbench.capture` wrote in your program, or of arrays by MjData field, as `mjbench.record`"
    " returns them.",
)
ACTIONS = click.option(
    "--actions",
    "actions_file",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Take controls from this .npz or .npy file: an array `ctrl` or `actions` of shape"
    " (ncontrol, nu) or (nsequence, ncontrol, nu). Each row is held for --hold steps.",
)
SETTLE = click.option(
    "--settle",
    "settle_s",
    type=Seconds(zero=True),
    help="Simulated time for which the model moves before the first start state; 0 starts at"
    " keyframe 0  [default: 0.1s with a keyframe, 5s without]",
)
STARTS = (SETTLE, STATES, ACTIONS)
SIZES = (
    click.option("--nbatch", type=COUNT, help="Simulations of a run."),
    click.option("--nstep", type=COUNT, help="Steps of each simulation."),
    HOLD,
    SEED,
    *STARTS,
)
