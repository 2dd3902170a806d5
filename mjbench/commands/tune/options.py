"""The options of `mjbench tune`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    StartOptions,
    TimeLimitOptions,
    hold_option,
)
from mjbench.commands.tune.setting_names import IN_GROUPS
from mjbench.options import NAMES, choice, option, share


@dataclass(frozen=True, kw_only=True)
class TuneOptions(BudgetOptions, StartOptions, TimeLimitOptions, OutputOptions):
    """What a search for faster settings may cost, and what may come out of it."""

    EACH_S, QUICK_S = 300.0, 60.0
    only: list[str] | None = option(
        None, NAMES, f"Try only these settings, by names or groups: {IN_GROUPS}", unset="all"
    )
    skip: list[str] | None = option(
        None, NAMES, "Leave out these settings, named as for --only, such as excludes,timestep."
    )
    allow: str = option(
        "approximate",
        choice("free", "equivalent", "approximate"),
        "Recommend settings with the same results (free), also those within the solver's tolerance"
        " (equivalent), or all (approximate).",
    )
    max_change: float | None = option(
        None,
        share(below=10.0),
        "Largest change to recommend: how far the motion is from that with your present settings,"
        " in percent of how far the model moves (1% of 1 m is 1 cm). Nine simulations in ten stay"
        " below it.",
    )
    max_error: float | None = option(
        None,
        share(below=10.0),
        "Largest error to recommend, in the same percent: how far the motion is from that of the"
        " same model at an eighth of its timestep, instead of from your present one. Give one of"
        " the two, or both",
        unset="the error of your present settings; with --max-change, any",
    )
    hold: int = hold_option(8)
