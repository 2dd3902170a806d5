"""The answer to the question whether a function is slower than a baseline, and what it rests on."""

from dataclasses import dataclass
from enum import StrEnum
from statistics import NormalDist

import numpy as np

from mjbench.instrument.units import duration


class Answer(StrEnum):
    """Whether the candidate is slower than it may be."""

    NOT_SLOWER = "not slower"
    """It is certainly not slower than the baseline by more than is allowed."""
    SLOWER = "slower"
    """It certainly is."""
    INCONCLUSIVE = "inconclusive"
    """The measurements do not tell."""


@dataclass(frozen=True)
class SpeedCheck:
    """What was measured of a candidate and its baseline.

    Attributes:
      max_slowdown: share of the baseline's time.
      ratio: the candidate's time over the baseline's; None without an estimate.
      low: lower end of the interval of `ratio`; None without one, as `high`.
      candidate_s: median seconds of a call; None where it was not timed.
      detail: why the answer is inconclusive; empty otherwise.
    """

    answer: Answer
    max_slowdown: float
    confidence: float
    ratio: float | None = None
    low: float | None = None
    high: float | None = None
    candidate_s: float | None = None
    baseline_s: float | None = None
    rounds: int = 0
    detail: str = ""

    def __str__(self) -> str:
        allowed = f"{100 * self.max_slowdown:g} % allowed"
        if self.ratio is None or self.low is None or self.high is None:
            return f"{self.answer}: {self.detail}"
        interval = f"{_signed(self.low)} to {_signed(self.high)} %"
        text = f"{self.answer}: {_signed(self.ratio)} % (interval {interval}, {allowed})"
        if self.candidate_s is not None and self.baseline_s is not None:
            times = duration(1e9 * self.candidate_s), duration(1e9 * self.baseline_s)
            text += f", {times[0]} a call, baseline {times[1]}"
        return f"{text}; {self.detail}" if self.detail else text


def margin(confidence: float, deviation: float) -> float:
    """Return half the width of the interval of a normal value."""
    return NormalDist().inv_cdf((1 + confidence) / 2) * deviation


def of_interval(low: float, high: float, max_slowdown: float) -> Answer:
    """Return what an interval of the log ratio of candidate time over baseline time shows.

    Args:
      max_slowdown: share of the baseline's time.
    """
    log_limit = float(np.log1p(max_slowdown))
    if high <= log_limit:
        return Answer.NOT_SLOWER
    if low > log_limit:
        return Answer.SLOWER
    return Answer.INCONCLUSIVE


def _signed(ratio: float) -> str:
    return f"{100 * (ratio - 1):+.1f}"
