"""Estimates of log ratios with their standard errors, and how pages write them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.formats import change_to_tenth
from mjbench.measuring import launch_stats


@dataclass(frozen=True)
class LogEstimate:
    """The time of a step or an operation in a release over that in the reference.

    Attributes:
      log_ratio: its natural logarithm.
      deviation: standard error of that.
    """

    log_ratio: float
    deviation: float

    @property
    def ratio(self) -> float:
        return math.exp(self.log_ratio)

    @classmethod
    def of_launches(
        cls, log_ratios: Sequence[float], residues: Sequence[int] | None
    ) -> "LogEstimate":
        """Return the mean of launches, more of them than residues (see `launch_stats.fit`)."""
        fitted = launch_stats.fit(launch_stats.cells(log_ratios, residues))
        return cls(float(fitted.mean[0]), float(fitted.deviation[0]))


def log_change(log_ratio: float) -> str:
    """Return a log ratio as a change in percent, or as a factor where it is at least twofold."""
    ratio = math.exp(log_ratio)
    return f"×{ratio:.2f}" if _is_factor(ratio) else change_to_tenth(ratio)


def change_with_error(estimate: LogEstimate | None) -> str:
    """Return an estimate with its standard error, such as `+1.2 ±0.3 %`; empty without one."""
    if estimate is None:
        return ""
    ratio = estimate.ratio
    error = ratio * estimate.deviation
    if _is_factor(ratio):
        return f"×{ratio:.2f} ±{error:.2f}"
    return f"{100 * (ratio - 1):+.1f} ±{100 * error:.1f} %"


def _is_factor(ratio: float) -> bool:
    return ratio >= 2 or ratio <= 0.5
