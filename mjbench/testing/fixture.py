"""What a test gets as `mjbench`: it passes, fails or skips by what was measured.

A test that cannot be decided skips, with its reason: to pass would claim what was not shown, to
fail would blame the code for a busy machine.
"""

from collections.abc import Callable
from typing import Any

import pytest

from mjbench.limits import SECONDS, SHARE
from mjbench.measuring import calls
from mjbench.measuring.calls import Function
from mjbench.paired.outcomes import CONFIDENCE
from mjbench.testing import callables
from mjbench.testing.callables import Answer, FunctionPair, SpeedCheck, SpeedQuestion

# How much slower than its baseline a function may be.
MAX_SLOWDOWN = 0.1
# Seconds for the answer.
TIME_LIMIT_S = 30.0


class SpeedFixture:
    """Compares the speed of functions for one test."""

    def __init__(self, request: pytest.FixtureRequest):
        self._request = request

    def not_slower(
        self,
        function: Function,
        baseline: Function,
        *,
        max_slowdown: float = MAX_SLOWDOWN,
        setup: Function | None = None,
        check: Callable[[Any, Any], bool] | None = None,
        confidence: float = CONFIDENCE,
        time_limit_s: float = TIME_LIMIT_S,
        allow_inconclusive: bool = True,
    ) -> SpeedCheck:
        """Fail the test if a function is certainly slower than a baseline; return the figures.

        Both run in turns, here and now. The test skips where measurements do not tell.

        Args:
          function: to judge; it is called without arguments, many times.
          baseline: a function, such as the implementation of before.
          max_slowdown: how much slower it may be, as a share of the baseline's time.
          setup: called before each block of calls, untimed, such as to reset the simulation: both
            functions then do the same work from the same start.
          check: called with what one call of the baseline and one of the function returned, before
            anything is timed; if it returns false, the test fails, because speeds of different work
            do not compare.
          confidence: of the answer, as a share.
          time_limit_s: for the answer.
          allow_inconclusive: whether to skip where measurements do not tell, rather than to fail.
        """
        __tracebackhide__ = True
        question = _question(max_slowdown, confidence, time_limit_s)
        if not callable(function):
            raise _failure(
                "not_slower needs a function to judge, which is called without arguments"
            )
        if not callable(baseline):
            raise _failure(
                "the baseline must be a function; with times that were stored, pytest-benchmark"
                " compares: --benchmark-save and --benchmark-compare"
            )
        result = self._compare(function, baseline, question, setup or calls.nothing, check)
        if result.answer == Answer.SLOWER:
            raise _failure(str(result))
        if result.answer == Answer.INCONCLUSIVE:
            if not allow_inconclusive:
                raise _failure(str(result))
            pytest.skip(f"mjbench: {result}")
        return result

    def _compare(
        self,
        function: Function,
        baseline: Function,
        question: SpeedQuestion,
        setup: Function,
        check: Callable[[Any, Any], bool] | None,
    ) -> SpeedCheck:
        __tracebackhide__ = True
        setup()
        expected = baseline()
        setup()
        returned = function()
        if check is not None and not check(expected, returned):
            raise _failure(
                "the function returns something else than its baseline: speeds do not compare"
            )
        if _are_disabled(self._request.config):
            reason = "benchmarks are disabled by an option of pytest"
            limits = question.max_slowdown, question.confidence
            return SpeedCheck(Answer.INCONCLUSIVE, *limits, detail=reason)
        return callables.compare(FunctionPair(baseline, function, setup), question)


def _question(max_slowdown: float, confidence: float, time_limit_s: float) -> SpeedQuestion:
    __tracebackhide__ = True
    for name, value, bounds in (
        ("confidence", confidence, SHARE),
        ("time_limit_s", time_limit_s, SECONDS),
    ):
        if value not in bounds:
            raise _failure(f"{name} must be {bounds}, not {value!r}")
    least = callables.least_slowdown(confidence)
    if not max_slowdown >= least:
        raise _failure(
            f"max_slowdown must be at least {least:.3g}, not {max_slowdown!r}: identical functions"
            " can differ by nearly as much from process to process"
        )
    return SpeedQuestion(max_slowdown, confidence, time_limit_s)


def _are_disabled(config: pytest.Config) -> bool:
    """Return whether an option of pytest-benchmark says that nothing is to be timed."""
    is_disabled = config.getoption("benchmark_disable", False)
    is_enabled = config.getoption("benchmark_enable", False)
    return bool(is_disabled and not is_enabled) or bool(config.getoption("benchmark_skip", False))


def _failure(reason: str) -> BaseException:
    return pytest.fail.Exception(f"mjbench: {reason}", pytrace=False)
