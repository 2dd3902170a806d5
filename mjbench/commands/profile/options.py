"""The options of `mjbench profile` and its modes."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    LoopStartOptions,
    OutputOptions,
    SizeOptions,
    TimeLimitOptions,
    budget_option,
    code_option,
    top_option,
)
from mjbench.options import NAMES, SECONDS, option


@dataclass(frozen=True, kw_only=True)
class ProfileOptions(LoopStartOptions, TimeLimitOptions, OutputOptions):
    """How the parts of a step are timed."""

    budget_s: float = budget_option(
        4.0, "Time for the steps of each model, and half of it for the frames of each backend."
    )


@dataclass(frozen=True, kw_only=True)
class HabitOptions(LoopStartOptions, TimeLimitOptions, OutputOptions):
    """How habits of a loop are timed."""

    code: bool = code_option("Print each habit's loop, and its cheaper form.")
    budget_s: float = budget_option(30.0, "About how long to time the habits of each model.")


@dataclass(frozen=True, kw_only=True)
class InstructionOptions(SizeOptions, OutputOptions):
    """How instructions are counted."""

    releases: list[str] | None = option(
        None, NAMES, "Releases to count in", "--release", unset="installed"
    )
    top: int = top_option()
    time_limit_s: float = option(
        600.0, SECONDS, "Kill a release's process that finishes no model for this long."
    )
    wait: None = None
