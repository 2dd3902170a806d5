"""Compare two functions of this process: blocks of calls in turns, until the answer is certain.

Calls run in quads, ABBA or BAAB at random (A is the baseline), as in paired comparisons, so that
drift and the order of turns hit both functions alike. Some quads are a round; their log ratio (see
`stats.paired_log_ratio`) is a sample of an anytime-valid interval, which is looked at after each.

Closures cannot be sent to fresh processes, and where memory happens to lie makes one of two
identical functions faster for as long as a process lasts. So the interval also allows for
PROCESS_SPREAD, which no number of rounds makes smaller.
"""

import contextlib
import functools
import math
import random
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from statistics import NormalDist

import numpy as np

from mjbench.formats import duration
from mjbench.interval import Interval
from mjbench.measuring import calls, launch_stats, stats, timing
from mjbench.measuring.calls import Function, nothing
from mjbench.measuring.timing import Clock

# Seconds of a round, at least.
ROUND_S = 0.1
# Quads of a round, at most.
MOST_QUADS = 100
# No time is shorter, in seconds: a clock may not tell two readings apart.
_SHORTEST_S = 1e-9
# Fewer rounds give no answer, however clear: see `paired.verdict.MIN_LAUNCHES`.
LEAST_ROUNDS = 8
# Standard deviation, from process to process, of the log ratio of identical functions
# (docs/python.md).
PROCESS_SPREAD = 0.02


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
      candidate_s: median seconds of a call; None where it was not timed.
      detail: why the answer is inconclusive; empty otherwise.
    """

    answer: Answer
    max_slowdown: float
    confidence: float
    ratio: Interval | None = None
    candidate_s: float | None = None
    baseline_s: float | None = None
    rounds: int = 0
    detail: str = ""

    @property
    def is_final(self) -> bool:
        """Whether more rounds would not change it."""
        return self.answer != Answer.INCONCLUSIVE or bool(self.detail)

    def __str__(self) -> str:
        allowed = f"{100 * self.max_slowdown:g} % allowed"
        if self.ratio is None or self.ratio.low is None or self.ratio.high is None:
            return f"{self.answer}: {self.detail}"
        interval = f"{_signed(self.ratio.low)} to {_signed(self.ratio.high)} %"
        text = f"{self.answer}: {_signed(self.ratio.estimate)} % (interval {interval}, {allowed})"
        if self.candidate_s is not None and self.baseline_s is not None:
            times = duration(1e9 * self.candidate_s), duration(1e9 * self.baseline_s)
            text += f", {times[0]} a call, baseline {times[1]}"
        return f"{text}; {self.detail}" if self.detail else text


@dataclass(frozen=True)
class SpeedQuestion:
    """What is asked of two functions.

    Attributes:
      max_slowdown: share of the baseline's time.
      time_limit_s: no round begins after it.
    """

    max_slowdown: float
    confidence: float
    time_limit_s: float


@dataclass(frozen=True)
class FunctionPair:
    """Two functions to compare.

    Attributes:
      setup: called before each block, untimed, to give both functions the same start.
    """

    baseline: Function
    candidate: Function
    setup: Function = nothing


def least_slowdown(confidence: float) -> float:
    """Return the smallest slowdown that one process can decide, as a share."""
    return math.expm1(_margin(confidence))


@contextlib.contextmanager
def _untraced() -> Iterator[None]:
    """Pause what traces every line of this thread, such as a debugger, while the block runs."""
    trace = sys.gettrace()
    sys.settrace(None)
    try:
        yield
    finally:
        sys.settrace(trace)


@_untraced()
def compare(
    pair: FunctionPair,
    question: SpeedQuestion,
    clock: Clock = time.perf_counter,
    rng: random.Random | None = None,
) -> SpeedCheck:
    """Return whether a function is slower than a baseline.

    Args:
      rng: draws the order of each quad; None for one that differs in every process.
    """
    rng, begin = rng or random.Random(), clock()
    count = min(
        _calls_per_block(function, pair.setup, clock)
        for function in (pair.baseline, pair.candidate)
    )
    rounds: list[_Round] = []
    log_ratios: list[float] = []
    while True:
        rounds.append(_time_round(pair, count, clock, rng))
        log_ratios.append(rounds[-1].log_ratio)
        check = _judge(log_ratios, question)
        if not check.is_final:
            spent_s = clock() - begin
            if spent_s * (1 + 1 / len(rounds)) <= question.time_limit_s:
                continue
            check = replace(check, detail=_too_little_time(len(rounds), question))
        return replace(
            check,
            candidate_s=statistics.median(each.block_s("B") for each in rounds) / count,
            baseline_s=statistics.median(each.block_s("A") for each in rounds) / count,
        )


def _too_little_time(rounds: int, question: SpeedQuestion) -> str:
    limit = f"{question.time_limit_s:g} s (time_limit_s)"
    if rounds < LEAST_ROUNDS:
        return f"only {rounds} of {LEAST_ROUNDS} rounds fit into {limit}"
    return f"not certain within {limit}"


def _judge(log_ratios: Sequence[float], question: SpeedQuestion) -> SpeedCheck:
    here = launch_stats.evidence(log_ratios, question.confidence).interval
    between = _margin(question.confidence)
    interval = Interval.around(here.estimate, math.hypot(here.half_width, between))
    check = SpeedCheck(
        Answer.INCONCLUSIVE,
        question.max_slowdown,
        question.confidence,
        ratio=interval.exponential,
        rounds=len(log_ratios),
    )
    if len(log_ratios) < LEAST_ROUNDS:
        return check
    limit = math.log1p(question.max_slowdown)
    answer = of_interval(interval, limit)
    is_near = here.is_above(limit - between) and here.is_below(limit + between)
    if answer == Answer.INCONCLUSIVE and is_near:
        detail = (
            "identical functions can differ by that much from process to process: allow more"
            " (max_slowdown), or repeat it"
        )
        return replace(check, detail=detail)
    return replace(check, answer=answer)


def _calls_per_block(function: Function, setup: Function, clock: Clock) -> int:
    """Return how many calls of a function last as long as a block, after a first one."""
    function()

    def block_s(count: int) -> float:
        setup()
        return timing.block_s(timing.Contender(_block(function, count)), clock)

    return calls.calls_per_block(block_s)


@dataclass(frozen=True, eq=False)
class _Round:
    """Some quads: their orders, and (quads, 4) seconds of blocks."""

    orders: Sequence[str]
    seconds: np.ndarray

    @property
    def log_ratio(self) -> float:
        return stats.paired_log_ratio(self.orders, self.seconds)

    def block_s(self, letter: str) -> float:
        """Return the median seconds of the baseline's blocks (A), or of the candidate's (B)."""
        is_of = np.array([[each == letter for each in order] for order in self.orders])
        return float(np.median(self.seconds[is_of]))


def _block(function: Function, count: int) -> Callable[[], None]:
    return functools.partial(calls.repeat, function, count)


def _time_round(pair: FunctionPair, count: int, clock: Clock, rng: random.Random) -> _Round:
    blocks = _block(pair.baseline, count), _block(pair.candidate, count)
    orders, times, spent_s = list[str](), list[list[float]](), 0.0
    while spent_s < ROUND_S and len(orders) < MOST_QUADS:
        drawn = timing.draw_orders(1, rng)
        times += timing.block_times(*blocks, drawn, clock, pair.setup)
        orders += drawn
        spent_s += sum(times[-1])
    return _Round(orders, np.maximum(times, _SHORTEST_S))


def _margin(confidence: float) -> float:
    """Return half the width of the interval that is due to where memory happens to lie."""
    return NormalDist().inv_cdf((1 + confidence) / 2) * PROCESS_SPREAD


def of_interval(log_ratio: Interval, log_limit: float) -> Answer:
    """Return what an interval of candidate time over baseline time, as logarithms, shows."""
    if log_ratio.high is not None and log_ratio.high <= log_limit:
        return Answer.NOT_SLOWER
    if log_ratio.is_above(log_limit):
        return Answer.SLOWER
    return Answer.INCONCLUSIVE


def _signed(ratio: float) -> str:
    return f"{100 * (ratio - 1):+.1f}"
