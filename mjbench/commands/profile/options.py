"""The options of `mjbench profile` and its modes."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    LoopStartOptions,
    OutputOptions,
    SizeOptions,
    TimeLimitOptions,
    code_option,
    nbatch_option,
    nstep_option,
    time_limit_option,
    top_option,
)
from mjbench.options import NAMES, option


@dataclass(frozen=True, kw_only=True)
class ProfileOptions(BudgetOptions, LoopStartOptions, TimeLimitOptions, OutputOptions):
    """How the parts of a step are timed."""

    EACH_S, QUICK_S = 10.0, 5.0


@dataclass(frozen=True, kw_only=True)
class HabitOptions(BudgetOptions, LoopStartOptions, TimeLimitOptions, OutputOptions):
    """How habits of a loop are timed."""

    EACH_S, QUICK_S = 30.0, 10.0
    code: bool = code_option()


@dataclass(frozen=True, kw_only=True)
class InstructionOptions(SizeOptions, OutputOptions):
    """How instructions are counted."""

    releases: list[str] | None = option(None, NAMES, "Releases to count in", unset="installed")
    top: int = top_option()
    nbatch: int | None = nbatch_option("2")
    nstep: int | None = nstep_option("50")
    time_limit_s: float = time_limit_option(600.0)
    wait: None = None
