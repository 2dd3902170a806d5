"""A function against its own time on an earlier occasion, which pytest-benchmark stored.

The absolute time of the same code differs by tens of percent from hour to hour on a shared machine.
So blocks of the function alternate with two calibrators on both occasions, and what is compared is
the ratio of the two. That ratio still differs from occasion to occasion, however many calls are
timed: the interval allows for OCCASION_SPREAD, and covers the intervals by both calibrators. A time
of another machine, or without calibrators, gives no answer.

pytest-benchmark times the function and writes the file; the calibrators' part is its `extra_info`.
"""

import math
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np

from mjbench.errors import InputError, one_line, shown
from mjbench.instrument import anytime, machine
from mjbench.instrument.anytime import Interval
from mjbench.instrument.timing import Clock
from mjbench.testing import calibrator, callables
from mjbench.testing.answer import Answer, SpeedCheck, margin, of_interval
from mjbench.testing.callables import Function, Question, calls_per_block

# The key in `extra_info`.
KEY = "mjbench"
# Standard deviation of the calibrated log time of one function from occasion to occasion: what that
# of the better calibrator hardly exceeds, on a machine that others keep busy (docs/python.md).
OCCASION_SPREAD = 0.05
# Seconds of timing; rounds of one block of each, at least and at most; groups of rounds, whose
# medians are the samples.
BUDGET_S, LEAST_ROUNDS, MOST_ROUNDS, GROUPS = 2.0, 24, 2000, 8
# Each calibrator runs for this share of a block of the function, in whole pieces of work.
_CALIBRATOR_SHARE, _MOST_PIECES = 0.1, 50


class IncomparableError(InputError):
    """A stored time cannot be compared with here and now; nothing is wrong with the test."""


class Benchmark(Protocol):
    """The parts of pytest-benchmark's fixture `benchmark` that are used."""

    disabled: bool
    extra_info: dict[str, Any]
    stats: Any

    def pedantic(
        self, target: Function, *, teardown: Function, rounds: int, iterations: int
    ) -> object:
        """Time rounds of calls."""


@dataclass(frozen=True)
class Occasion:
    """What was measured on one occasion, as `extra_info` holds it.

    Attributes:
      calibrators: version of their work.
      cpu: the processor's name.
      compute_log_ratios: natural logarithms of the function's time over that of the calibrator that
        computes, one for each group of rounds.
      memory_log_ratios: the same for the calibrator that copies memory.
    """

    calibrators: int
    cpu: str
    compute_log_ratios: Sequence[float]
    memory_log_ratios: Sequence[float]

    @property
    def is_sound(self) -> bool:
        """Whether all that it holds can be used."""
        both = self.compute_log_ratios, self.memory_log_ratios
        return all(len(logs) > 1 and all(map(math.isfinite, logs)) for logs in both)


@dataclass(frozen=True)
class SavedMachine:
    """The part of pytest-benchmark's `machine_info` that must be the same to compare times."""

    node: str = ""
    machine: str = ""
    system: str = ""
    python_implementation: str = ""
    python_version: str = ""

    @classmethod
    def here(cls) -> "SavedMachine":
        """Return that of this process."""
        return cls(
            platform.node(),
            platform.machine(),
            platform.system(),
            platform.python_implementation(),
            platform.python_version(),
        )


@dataclass(frozen=True)
class SavedBenchmark:
    """One test in a file of pytest-benchmark."""

    fullname: str
    extra_info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SavedRun:
    """A file of pytest-benchmark."""

    machine_info: SavedMachine
    benchmarks: Sequence[SavedBenchmark]


def least_slowdown(confidence: float) -> float:
    """Return the smallest slowdown that a stored time can decide, as a share."""
    return math.expm1(margin(confidence, math.sqrt(2) * OCCASION_SPREAD))


def measure(
    benchmark: Benchmark,
    function: Function,
    setup: Function,
    clock: Clock = time.perf_counter,
) -> Occasion:
    """Time a function by pytest-benchmark, in turns with the calibrators.

    Args:
      benchmark: the fixture, which keeps times and result for the file.
      function: to time.
      setup: called before each block, untimed.
      clock: returns seconds; for the calibrators.
    """
    calls = calls_per_block(function, setup, clock)
    setup()
    block_s = callables.block_s(function, calls, clock)
    timers = [
        _CalibratorTimer(work, _CALIBRATOR_SHARE * block_s, clock)
        for work in (calibrator.compute, calibrator.copy)
    ]
    round_s = block_s + sum(timer.round_s for timer in timers)
    rounds = _within(math.ceil(BUDGET_S / round_s), LEAST_ROUNDS, MOST_ROUNDS)

    def between_rounds() -> None:
        for timer in timers:
            timer.time()
        setup()

    with callables.untraced():
        between_rounds()
        benchmark.pedantic(function, teardown=between_rounds, rounds=rounds, iterations=calls)
    function_s = list(benchmark.stats.stats.data)
    logs = [group_log_ratios(function_s, timer.seconds) for timer in timers]
    occasion = Occasion(calibrator.VERSION, machine.cpu_name(), *logs)
    benchmark.extra_info[KEY] = msgspec.to_builtins(occasion)
    return occasion


class _CalibratorTimer:
    """Times a calibrator before each round, and after the last one.

    Attributes:
      round_s: seconds that it takes in a round, about.
      seconds: of a piece of its work, in each round: a median.
    """

    def __init__(self, work: Callable[[], object], wanted_s: float, clock: Clock):
        """Prepare; `wanted_s` is for how many seconds it should run in a round."""
        self._work, self._clock = work, clock
        self.seconds: list[float] = []
        work()
        piece_s = max(callables.block_s(work, 1, clock), 1e-9)
        self._pieces = _within(math.ceil(wanted_s / piece_s), 1, _MOST_PIECES)
        self.round_s = self._pieces * piece_s

    def time(self) -> None:
        """Time the pieces of a round."""
        pieces = [callables.block_s(self._work, 1, self._clock) for _ in range(self._pieces)]
        self.seconds.append(statistics.median(pieces))


def group_log_ratios(function_s: Sequence[float], calibrator_s: Sequence[float]) -> list[float]:
    """Return the log ratio of each group of rounds: a median.

    Args:
      function_s: seconds of a call in each round.
      calibrator_s: seconds of a calibrator before each round, and after the last one.
    """
    count = len(function_s)
    logs = np.log(np.maximum(calibrator_s[: count + 1], 1e-9))
    around = (logs[:-1] + logs[1:]) / 2
    ratios = np.log(np.maximum(function_s, 1e-12)) - around
    return [float(np.median(group)) for group in np.array_split(ratios, min(GROUPS, count))]


def read(file: Path) -> SavedRun:
    """Return a file that pytest-benchmark wrote.

    Raises:
      InputError: it cannot be read, or is none.
    """
    try:
        return msgspec.json.decode(file.read_bytes(), type=SavedRun)
    except OSError as error:
        raise InputError(f"cannot read {shown(str(file))}: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"{shown(str(file))} is no file of pytest-benchmark: {one_line(error, 100)}"
        ) from error


def find(run: SavedRun, fullname: str) -> Occasion:
    """Return what a file holds of a test.

    Args:
      run: the file.
      fullname: of the test, such as `tests/test_speed.py::test_env`.

    Raises:
      IncomparableError: it holds nothing that can be compared with here.
    """
    _check_machine(run.machine_info)
    entry = next((each for each in run.benchmarks if each.fullname == fullname), None)
    if entry is None:
        raise IncomparableError(f"the baseline has no time of {fullname}: save it again")
    if KEY not in entry.extra_info:
        raise IncomparableError(
            "the baseline has no calibration, without which times of two occasions do not compare:"
            " save it by a test that calls mjbench.not_slower"
        )
    try:
        occasion = msgspec.convert(entry.extra_info[KEY], Occasion)
    except msgspec.ValidationError as error:
        reason = f"the baseline's calibration cannot be read: {one_line(error, 100)}"
        raise IncomparableError(reason) from error
    _check_calibration(occasion)
    return occasion


def _check_machine(saved: SavedMachine) -> None:
    here = SavedMachine.here()
    differing = [
        f"{each.name} {getattr(saved, each.name) or 'unknown'}, here {getattr(here, each.name)}"
        for each in fields(SavedMachine)
        if getattr(saved, each.name) != getattr(here, each.name)
    ]
    if differing:
        reason = f"the baseline is of another machine or Python ({'; '.join(differing)})"
        raise IncomparableError(one_line(reason))


def _check_calibration(occasion: Occasion) -> None:
    if not occasion.is_sound:
        raise IncomparableError("the baseline's calibration is damaged")
    if occasion.calibrators != calibrator.VERSION:
        raise IncomparableError("another version of mjbench calibrated the baseline: save it again")
    if occasion.cpu != machine.cpu_name():
        raise IncomparableError(f"the baseline is of another processor ({shown(occasion.cpu)})")


def judge(
    baseline: Occasion, candidate: Occasion, question: Question, candidate_s: float, rounds: int
) -> SpeedCheck:
    """Return whether a function is slower than it was.

    Args:
      baseline: the earlier occasion.
      candidate: that of now.
      question: what is asked.
      candidate_s: median seconds of a call, now.
      rounds: that were timed.
    """
    intervals = [
        _interval(baseline.compute_log_ratios, candidate.compute_log_ratios, question.confidence),
        _interval(baseline.memory_log_ratios, candidate.memory_log_ratios, question.confidence),
    ]
    low, high = min(each.low for each in intervals), max(each.high for each in intervals)
    log_ratio = statistics.mean(each.mean for each in intervals)
    answer = of_interval(low, high, question.max_slowdown)
    detail = ""
    if answer == Answer.INCONCLUSIVE:
        detail = "a stored time decides no smaller change; give the old function as the baseline"
    return SpeedCheck(
        answer,
        question.max_slowdown,
        question.confidence,
        ratio=math.exp(log_ratio),
        low=math.exp(low),
        high=math.exp(high),
        candidate_s=candidate_s,
        baseline_s=candidate_s / math.exp(log_ratio),
        rounds=rounds,
        detail=detail,
    )


def _interval(before: Sequence[float], now: Sequence[float], confidence: float) -> Interval:
    """Return the interval of the difference of log ratios of two occasions."""
    means, deviations = zip(*map(anytime.mean_and_deviation, (before, now)), strict=True)
    difference = means[1] - means[0]
    deviation = math.hypot(OCCASION_SPREAD, OCCASION_SPREAD, *deviations)
    half_width = margin(confidence, deviation)
    return Interval(difference, difference - half_width, difference + half_width, len(now))


def _within(value: int, least: int, most: int) -> int:
    return max(least, min(value, most))
