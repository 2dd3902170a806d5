"""The options of `mjbench run`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import OutputOptions
from mjbench.limits import SAMPLES_PER_S
from mjbench.options import SECONDS, count, option, text


@dataclass(frozen=True, kw_only=True)
class RunOptions(OutputOptions):
    """How a program is run."""

    seconds: float | None = option(
        None,
        SECONDS,
        "End the program, as Ctrl-C would, when it has stepped for this long; with MJX alone, this"
        " counts from its first compiled function",
        "--seconds",
        "--budget",
        unset="run it to its end",
    )
    rate_hz: int | None = option(
        None,
        count(SAMPLES_PER_S),
        "Samples of the program's stacks per second",
        "--sample-rate",
        unset="100; 20 of a program with several child processes",
    )
    python: str | None = option(
        None,
        text("FILE"),
        "Python interpreter that runs the program",
        unset="the one that runs mjbench",
        of_functions=False,
    )
    resume: None = None
