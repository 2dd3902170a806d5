"""The options of `mjbench latency`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    StartOptions,
    TimeLimitOptions,
    fail_on_option,
    nstep_option,
)
from mjbench.options import COUNT, HERTZ, SECONDS, option
from mjbench.status import ExitCode, exit_code

if TYPE_CHECKING:
    from mjbench.commands.latency.measure import LatencyRow


@dataclass(frozen=True, kw_only=True)
class LatencyOptions(BudgetOptions, StartOptions, TimeLimitOptions, OutputOptions):
    """How single ticks are measured."""

    EACH_S, QUICK_S = 15.0, 5.0
    tick: int = option(
        1,
        COUNT,
        "Steps of a tick: a controller sets controls once, then takes so many steps. Rate, deadline"
        " and latency are of ticks.",
    )
    deadline_s: float | None = option(
        None,
        SECONDS,
        "Time by which a tick should end",
        unset="the time between two paced ticks; free-running, the simulated time of a tick",
    )
    rate_hz: float | None = option(
        None, HERTZ, "Paced ticks per second", unset="1 / (timestep × --tick)"
    )
    nstep: int | None = nstep_option(
        "10,000 ticks, or what the budget allows", of="measured at each pace"
    )
    findings: Sequence[str] | None = fail_on_option(
        ["missed"],
        "`missed`: a tick, even one of 10,000, ends after its deadline, free-running or paced.",
    )

    def exit_code(self, rows: Sequence["LatencyRow"]) -> ExitCode:
        """Return the exit code that rows stand for; a failure outweighs a finding."""
        code = exit_code(row.status for row in rows)
        is_missed = bool(self.findings) and any(row.missed for row in rows)
        return ExitCode.FINDING if code == ExitCode.OK and is_missed else code
