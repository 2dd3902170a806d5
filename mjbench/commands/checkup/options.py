"""The options of `mjbench checkup`."""

from dataclasses import dataclass

from mjbench.commands.run.options import ProgramOptions
from mjbench.commands.shared_options import (
    LoopStartOptions,
    OutputOptions,
    TimeLimitOptions,
    WholeBudgetOptions,
    code_option,
)


@dataclass(frozen=True, kw_only=True)
class CheckupOptions(
    WholeBudgetOptions, ProgramOptions, LoopStartOptions, TimeLimitOptions, OutputOptions
):
    """What a check-up may cost, and where it is written."""

    EACH_S, QUICK_S = 60.0, 15.0
    BUDGET_NOTE = "; if given, or with --quick, it ends a program even before --seconds"
    code: bool = code_option()
    resume: None = None
