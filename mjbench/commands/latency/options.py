"""The options of `mjbench latency`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    OutputOptions,
    TimeLimitOptions,
    WorkOptions,
    budget_option,
)
from mjbench.options import COUNT, HERTZ, SECONDS, option


@dataclass(frozen=True, kw_only=True)
class LatencyOptions(WorkOptions, TimeLimitOptions, OutputOptions):
    """How single steps are measured."""

    deadline_s: float | None = option(
        None,
        SECONDS,
        "Time by which a step should end",
        unset="the time between two paced steps; free-running, the model's timestep",
    )
    rate_hz: float | None = option(None, HERTZ, "Paced steps per second", unset="real time")
    nstep: int | None = option(
        None, COUNT, "Steps at each pace", unset="10,000, or what the budget allows"
    )
    budget_s: float = budget_option(
        10.0, "Time for the steps of each pace, if there are more than 1,000."
    )
