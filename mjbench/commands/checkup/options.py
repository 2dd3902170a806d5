"""The options of `mjbench checkup`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    LoopStartOptions,
    OutputOptions,
    TimeLimitOptions,
    budget_option,
    code_option,
)
from mjbench.options import FLAG, option

# Seconds of a check-up, and of a quick one.
TOTAL_S, QUICK_S = 60.0, 15.0


@dataclass(frozen=True, kw_only=True)
class CheckupOptions(LoopStartOptions, TimeLimitOptions, OutputOptions):
    """What a check-up may cost, and where it is written."""

    quick: bool = option(False, FLAG, "Take 15 seconds, whatever --budget is, and try no settings.")
    budget_s: float = budget_option(TOTAL_S, "Time in all; a program runs for two thirds of it.")
    code: bool = code_option()
    resume: None = None
