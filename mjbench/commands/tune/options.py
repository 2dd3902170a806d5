"""The options of `mjbench tune`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    StartOptions,
    TimeLimitOptions,
)
from mjbench.options import COUNT, NAMES, choice, option, share


@dataclass(frozen=True, kw_only=True)
class TuneOptions(BudgetOptions, StartOptions, TimeLimitOptions, OutputOptions):
    """What a search for faster settings may cost, and what may come out of it."""

    EACH_S, QUICK_S = 300.0, 60.0
    only: str | None = option(
        None,
        choice("free", "equivalent", "approximate"),
        "Recommend settings with the same results (free), also those within the solver's tolerance"
        " (equivalent), or all (approximate)",
        unset="approximate",
    )
    skip: list[str] | None = option(
        None,
        NAMES,
        "Settings to leave alone, by their names in the table of settings, such as"
        " excludes,timestep",
    )
    max_error: float | None = option(
        None,
        share(below=10.0),
        "Largest error to recommend, in percent of how far the model moves, in nine runs of ten:"
        " 1% of a motion of 1 m is 1 cm",
        unset="the error that your present settings have",
    )
    hold: int = option(
        8, COUNT, "Steps for which each control is held; timesteps must divide that time"
    )
