"""The options of `mjbench run`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import OutputOptions
from mjbench.limits import SAMPLES_PER_S
from mjbench.options import SECONDS, count, option, or_none, text

# Seconds for which a program steps before it is ended.
PROGRAM_S = 40.0


@dataclass(frozen=True, kw_only=True)
class ProgramOptions:
    """How a program is started and ended."""

    seconds: float | None = option(
        PROGRAM_S,
        or_none(SECONDS),
        "End the program, as Ctrl-C would, when it has stepped for this long, with MJX alone"
        " from its first compiled function on; `none` runs it to its end.",
        "--seconds",
    )
    python: str | None = option(
        None,
        text("FILE"),
        "Python interpreter that runs the program",
        unset="the one that runs mjbench",
        of_functions=False,
    )


@dataclass(frozen=True, kw_only=True)
class RunOptions(ProgramOptions, OutputOptions):
    """How a program is observed."""

    rate_hz: int | None = option(
        None,
        count(SAMPLES_PER_S),
        "Samples of the program's stacks per second",
        "--sample-rate",
        unset="100; 20 of a program with several child processes",
    )
    resume: None = None
