"""Options that several commands share, and the types of their values."""

import functools
import inspect
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mjbench import limits
from mjbench.cli.context import OutputOptions
from mjbench.errors import InputError, one_line
from mjbench.limits import TIME_LIMIT_S, Bounds
from mjbench.paired import outcomes
from mjbench.paired.metrics import METRICS, Metric
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.paired.run_sizes import Sizes
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.simulation.starts import StartPlan

_Value = TypeVar("_Value")
_Number = TypeVar("_Number", int, float)
_Parsed = TypeVar("_Parsed")

# Where run files are stored unless --results says otherwise.
RESULTS_FOLDER = Path("results/runs")


class Text(click.ParamType[_Value]):
    """A text that stands for a value."""

    def __init__(self, name: str, expected: str, parse: Callable[[str], _Value]):
        """Take what it is called in help, and how it is read.

        Args:
          expected: what it is to be, for the message about another one.
          parse: raises ValueError if a text stands for no value.
        """
        self.name, self._expected, self._parse = name, expected, parse

    def convert(self, value: Any, param: Any, ctx: Any) -> _Value:
        """Return the value; a default may be one already."""
        if not isinstance(value, str):
            return value  # type: ignore[no-any-return]
        try:
            return self._parse(value)
        except ValueError as error:
            is_part = isinstance(error, WordError) and error.word != value
            word = f": {one_line(repr(error.args[0]), 60)}" if is_part else ""
            self.fail(f"{one_line(repr(value), 60)} is not {self._expected}{word}", param, ctx)


class WordError(ValueError):
    """A word of a list is refused."""

    def __init__(self, word: str):
        super().__init__(word)
        self.word = word


def parsed(text: str, parse: Callable[[str], _Parsed]) -> list[_Parsed]:
    """Return what the words of a list with commas stand for.

    Raises:
      WordError: `parse` refuses one by a ValueError.
    """
    values = []
    for word in text.split(","):
        try:
            values.append(parse(word))
        except ValueError:
            raise WordError(word) from None
    return values


def _within(number: _Number, bounds: Bounds) -> _Number:
    if number not in bounds:
        raise ValueError
    return number


def numbers(bounds: Bounds = limits.COUNT) -> Text[list[int]]:
    """Return the type of comma-separated whole numbers, each of them once."""

    def parse(text: str) -> list[int]:
        return list(dict.fromkeys(parsed(text, lambda word: _within(int(word), bounds))))

    return Text("N,N,…", f"a list of whole numbers such as 1,2,4, each {bounds}", parse)


def count(bounds: Bounds = limits.COUNT) -> Text[int]:
    return Text("N", f"a whole number, {bounds}", lambda text: _within(int(text), bounds))


def _large_count(text: str) -> int:
    number = _within(float(text), limits.LARGE_COUNT)
    if number != int(number):
        raise ValueError
    return int(number)


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise ValueError
    return names


def _share(word: str) -> float:
    return float(word.strip().removesuffix("%")) / 100


def share(below: float = 1.0) -> Text[float]:
    """Return the type of a percentage such as `1%` or `0.5`, as a share above 0."""
    bounds = Bounds(0, below, is_open=True, is_open_above=True)
    expected = f"a percentage such as 1%, above 0% and below {100 * below:g}%"
    return Text("PERCENT", expected, lambda text: _within(_share(text), bounds))


# By how a time ends; longer endings first.
_SECONDS_PER = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "s": 1.0}


def seconds(zero: bool = False) -> Text[float]:
    """Return the type of a time such as `60s`, `1ms` or `0.5`; above 0 unless `zero`."""
    bounds = limits.SECONDS_OR_ZERO if zero else limits.SECONDS

    def parse(text: str) -> float:
        text = text.strip()
        unit = next((unit for unit in _SECONDS_PER if text.endswith(unit)), "")
        time_s = float(text.removesuffix(unit)) * _SECONDS_PER.get(unit, 1.0)
        return abs(_within(time_s, bounds))  # abs: -0 is 0

    return Text("SECONDS", f"a time such as 60s, {bounds}", parse)


def _hertz(text: str) -> float:
    return _within(float(text.strip().removesuffix("Hz")), limits.HERTZ)


COUNT, SEED_NUMBER, THREAD_COUNTS = count(), count(limits.SEED), numbers(limits.THREADS)
LARGE_COUNT = Text(
    "N", f"a whole number such as 1000000 or 1e9, {limits.LARGE_COUNT}", _large_count
)
NAMES = Text("NAME,…", "a name, or several with commas", _names)
HERTZ = Text("HZ", f"a number of times per second such as 1000, {limits.HERTZ}", _hertz)


class FileName(click.Path):
    """The name of a file, which is not empty."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:
        if not os.fspath(value):
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


FILE = FileName(path_type=Path)


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
    def add(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def as_one(
    argument: str, build: Callable[..., Any], *options: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, which gets them as one argument.

    Args:
      build: returns the argument; its parameters are named as the options.
      options: among them may be others that are one argument.
    """
    names = inspect.signature(build).parameters

    def add(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def with_one(*arguments: Any, **values: Any) -> None:
            own = {name: values.pop(name) for name in names if name in values}
            command(*arguments, **{argument: build(**own)}, **values)

        return with_options(*options)(with_one)

    return add


def models_argument(*default: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the argument MODEL to a command, which gets `sources`.

    Args:
      default: models of a command line without any: none stands for all shipped ones, which
        comparisons have; what looks closely at one model has the cart-pole.
    """

    def sources(names: tuple[str, ...]) -> list[ModelSource]:
        return [models.resolve(name) for name in names or default or models.shipped()]

    argument = click.argument("names", nargs=-1, metavar="[MODEL]…")
    return as_one("sources", sources, argument)


def mode(flag: str, text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that names a mode in a command's help (see `command_names`)."""
    return click.option(flag, is_flag=True, expose_value=False, help=f"{text} ({flag} --help)")


def budget(default_s: float, text: str, zero: bool = False) -> Callable[..., Any]:
    """Return the option --budget of a command, which gets `budget_s`.

    Args:
      text: what the time is for, for the help.
      zero: whether it may be 0, for as little as possible.
    """
    return click.option(
        "--budget",
        "budget_s",
        type=seconds(zero),
        default=f"{default_s:g}s",
        show_default=True,
        help=text,
    )


def check_sizes(nstep: int | None, hold: int) -> None:
    """Refuse a number of steps that is not a multiple of hold."""
    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of --hold {hold}")


def _start_plan(
    settle_s: float | None = None, states_file: Path | None = None, actions_file: Path | None = None
) -> "StartPlan":
    from mjbench.simulation import starts

    return starts.start_plan(settle_s, states_file, actions_file)


def _sizes(
    starts: "StartPlan",
    nbatch: int | None = None,
    nstep: int | None = None,
    hold: int = 1,
    seed: int = 0,
) -> "Sizes":
    from mjbench.paired.run_sizes import Sizes

    check_sizes(nstep, hold)
    return Sizes(nbatch, nstep, hold, seed, starts)


def _verdict_plan(
    min_effect: float,
    confidence: float,
    precision: float,
    budget_s: float,
    as_shipped: bool,
    sizes: "Sizes",
) -> "VerdictPlan":
    from mjbench.paired.verdict import VerdictPlan

    return VerdictPlan(min_effect, confidence, precision, budget_s, sizes, as_shipped)


def metric_option(*metrics: Metric) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the option --metric to a command, with these metrics."""
    meanings = "; ".join(f"`{metric}`, {METRICS[metric].meaning}" for metric in metrics)
    notes = [METRICS[metric].note for metric in metrics if METRICS[metric].note]
    help_text = " ".join([f"What to compare: {meanings}.", *notes])
    return click.option(
        "--metric",
        metavar="METRIC",
        type=click.Choice([metric.value for metric in metrics]),
        default=Metric.TIME.value,
        show_default=True,
        help=help_text,
    )


def _percentage(name: str, default: float, text: str) -> Callable[..., Any]:
    return click.option(
        name, type=share(), default=f"{100 * default:g}%", show_default=True, help=text
    )


JSON = click.option(
    "--json", "json_file", metavar="FILE|-", help="Write results as JSON to FILE, or - for stdout."
)
PAGE = click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=FILE,
    help="Write the page to FILE  [default: stdout]",
)
LIMIT = click.option(
    "--time-limit",
    "limit_s",
    type=seconds(),
    default=f"{TIME_LIMIT_S:g}s",
    show_default=True,
    help="Kill a model's process that reports nothing for this long.",
)


def results_option(folder: Path, text: str) -> Callable[..., Any]:
    return click.option(
        "--results", default=folder, show_default=True, metavar="DIR", type=FILE, help=text
    )


RESULTS = results_option(RESULTS_FOLDER, "Folder for run files.")
RESUME = click.option(
    "--resume",
    metavar="RUN",
    type=FILE,
    help="Continue this run file: what is finished in it is not measured again. The rest of the"
    " command must be as it was.",
)
THREADS = click.option(
    "--threads", type=THREAD_COUNTS, help="Thread counts  [default: 1 and usable cores]"
)
WAIT = click.option(
    "--wait", is_flag=True, help="Wait until no other mjbench measures on this machine."
)
CODE = click.option(
    "--code", is_flag=True, help="Print the Python code, too, such as that of advised paths."
)
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
_JUDGING = (
    _percentage(
        "--min-effect",
        outcomes.MIN_EFFECT,
        "Smallest change that matters; a change that is certainly smaller is `same`.",
    ),
    _percentage(
        "--confidence",
        outcomes.CONFIDENCE,
        "Confidence of the interval: at 99%, at most 1 in 100 comparisons of identical targets"
        " is called different.",
    ),
    _percentage(
        "--precision",
        outcomes.PRECISION,
        "Stop when half the interval's width is below this.",
    ),
    budget(
        outcomes.TIME_LIMIT_S,
        "Time for each verdict, once the models are loaded; after it, an uncertain one is"
        " `inconclusive`.",
    ),
    click.option(
        "--as-shipped",
        is_flag=True,
        help="Compare builds as they are. By default mjbench moves their machine code in memory"
        " from launch to launch, so that only what the code does makes a difference.",
    ),
)
OUTPUT = as_one("output", OutputOptions, RESULTS, WAIT, JSON)
COUNTS_OUTPUT = as_one("output", OutputOptions, RESULTS, RESUME, JSON)
STORING = as_one("output", OutputOptions, RESULTS, RESUME, WAIT, JSON)
STATES = click.option(
    "--states",
    "states_file",
    metavar="FILE.npz",
    type=FILE,
    help="Draw start states, and their controls if there are any, from this file, which"
    " `mjbench.capture` wrote in your program, or which has arrays by MjData field, as"
    " `mjbench.record` returns them.",
)
ACTIONS = click.option(
    "--actions",
    "actions_file",
    metavar="FILE",
    type=FILE,
    help="Take controls from this .npz or .npy file: an array `ctrl` or `actions` of shape"
    " (ncontrol, nu) or (nsequence, ncontrol, nu). Each row is held for the steps of"
    " a control.",
)
SETTLE = click.option(
    "--settle",
    "settle_s",
    type=seconds(zero=True),
    help="Simulated time for which the model moves before the first start state; 0 starts at"
    " keyframe 0  [default: 0.1s with a keyframe, 5s without]",
)
STARTS = as_one("starts", _start_plan, SETTLE, STATES, ACTIONS)
LOOP_STARTS = as_one("starts", _start_plan, SETTLE, STATES)
SIZES = as_one(
    "sizes",
    _sizes,
    click.option("--nbatch", type=COUNT, help="Simulations of a run."),
    click.option("--nstep", type=COUNT, help="Steps of each simulation."),
    *(HOLD, SEED, STARTS),
)
VERDICT_PLAN = as_one("plan", _verdict_plan, *_JUDGING, SIZES)
