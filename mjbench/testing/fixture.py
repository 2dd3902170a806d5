"""What a test gets as `mjbench`: it passes, fails or skips by what was measured.

A test that cannot be decided skips, with its reason: to pass would claim what was not shown, to
fail would blame the code for a busy machine.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from mjbench.errors import InputError, MachineError, shown
from mjbench.instrument import extras
from mjbench.paired.outcomes import CONFIDENCE
from mjbench.testing.answer import Answer, SpeedCheck

if TYPE_CHECKING:
    from mjbench.testing.callables import Function, Question
    from mjbench.testing.stored import Benchmark, SavedRun

# Packages of the extra `cli` that are needed.
_PACKAGES = ("msgspec", "numpy", "psutil", "scipy")
# How much slower a function may be than a baseline that is a function, and than a stored one.
MAX_SLOWDOWN, MAX_SLOWDOWN_OF_STORED = 0.1, 0.25
# Seconds for the answer on two functions.
TIME_LIMIT_S = 30.0


def create(request: pytest.FixtureRequest) -> "SpeedFixture":
    """Return the fixture of a test; the test fails in one line where packages are missing."""
    try:
        extras.require("the fixture mjbench", "cli", _PACKAGES)
    except MachineError as error:
        raise _failure(str(error)) from None
    return SpeedFixture(request)


class SpeedFixture:
    """Compares the speed of functions for one test."""

    def __init__(self, request: pytest.FixtureRequest):
        """Prepare for a test."""
        self._request = request

    def not_slower(
        self,
        function: "Function",
        baseline: "Function | str | os.PathLike[str]",
        *,
        max_slowdown: float | None = None,
        setup: "Function | None" = None,
        check: Callable[[Any, Any], bool] | None = None,
        confidence: float = CONFIDENCE,
        time_limit_s: float = TIME_LIMIT_S,
        allow_inconclusive: bool = True,
    ) -> SpeedCheck:
        """Fail the test if a function is certainly slower than a baseline; return the figures.

        A baseline that is a function, such as the implementation of before, is the better one:
        both run in turns, here and now. A name or a path is that of a file that pytest-benchmark
        saved in a run of this test (`--benchmark-save`, `--benchmark-autosave`,
        `--benchmark-json`).

        The test skips where measurements do not tell, or the baseline cannot be compared with.

        Args:
          function: to judge; it is called without arguments, many times.
          baseline: a function, or the file of an earlier run.
          max_slowdown: how much slower it may be, as a share of the baseline's time; None for 0.1,
            and for 0.25 with a stored baseline.
          setup: called before each block of calls, untimed, such as to reset the simulation: both
            functions then do the same work from the same start.
          check: called with what one call of the baseline and one of the function returned, before
            anything is timed; if it returns false, the test fails, because speeds of different work
            do not compare.
          confidence: of the answer, as a share.
          time_limit_s: for the answer on two functions.
          allow_inconclusive: whether to skip where measurements do not tell, rather than to fail.
        """
        __tracebackhide__ = True
        is_function = callable(baseline)
        if max_slowdown is None:
            max_slowdown = MAX_SLOWDOWN if is_function else MAX_SLOWDOWN_OF_STORED
        question = _question(max_slowdown, confidence, time_limit_s, is_function)
        if not callable(function):
            raise _failure(
                "not_slower needs a function to judge, which is called without arguments"
            )
        setup = setup or _nothing
        if callable(baseline):
            result = self._against_function(function, baseline, question, setup, check)
        elif check is not None:
            raise _failure("check needs a baseline that is a function: a file holds no results")
        else:
            result = self._against_file(function, Path(baseline), question, setup)
        if result.answer == Answer.SLOWER:
            raise _failure(str(result))
        if result.answer == Answer.INCONCLUSIVE:
            if not allow_inconclusive:
                raise _failure(str(result))
            pytest.skip(f"mjbench: {result}")
        return result

    def _against_function(
        self,
        function: "Function",
        baseline: "Function",
        question: "Question",
        setup: "Function",
        check: Callable[[Any, Any], bool] | None,
    ) -> SpeedCheck:
        from mjbench.testing import callables

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
            return _inconclusive(question, "benchmarks are disabled by an option of pytest")
        return callables.compare(callables.Pair(baseline, function, setup), question)

    def _against_file(
        self, function: "Function", baseline: Path, question: "Question", setup: "Function"
    ) -> SpeedCheck:
        from mjbench.testing import stored

        __tracebackhide__ = True
        if _are_disabled(self._request.config):
            setup()
            function()
            return _inconclusive(question, "benchmarks are disabled by an option of pytest")
        saved = self._saved_run(baseline)
        benchmark: Benchmark = self._request.getfixturevalue("benchmark")
        has_timed = benchmark.stats is not None
        if has_timed:
            raise _failure(
                "a test can time one function for a file: use a function as the other baseline"
            )
        if benchmark.disabled:
            setup()
            benchmark.pedantic(function, teardown=_nothing, rounds=1, iterations=1)
            return _inconclusive(question, "pytest-benchmark times nothing beside pytest-xdist")
        now = stored.measure(benchmark, function, setup)
        if saved is None:
            reason = f"there is no {shown(str(baseline))} yet, and this run saves its times"
            return _inconclusive(question, reason)
        try:
            before = stored.find(saved, self._request.node.nodeid)
        except stored.IncomparableError as error:
            return _inconclusive(question, str(error))
        stats = benchmark.stats.stats
        return stored.judge(before, now, question, stats.median, stats.rounds)

    def _saved_run(self, baseline: Path) -> "SavedRun | None":
        """Return the file of a baseline; None where there is none yet, and this run writes one.

        The test fails where the file is missing otherwise, or is none of pytest-benchmark; and
        where that is not installed.
        """
        from mjbench.testing import stored

        __tracebackhide__ = True
        config = self._request.config
        if config.getoption("benchmark_storage", None) is None:
            install = extras.install_command("test")
            raise _failure(f"a stored baseline needs pytest-benchmark: {install}")
        file = _stored_file(config, baseline)
        if file is None:
            saving = ("benchmark_save", "benchmark_autosave", "benchmark_json")
            if any(config.getoption(name) for name in saving):
                return None
            raise _failure(
                f"no stored baseline {shown(str(baseline))}: save one where the code is as it"
                f" should be, by pytest --benchmark-save={baseline.stem}"
            )
        try:
            return stored.read(file)
        except InputError as error:
            raise _failure(str(error)) from None


def _question(
    max_slowdown: float, confidence: float, time_limit_s: float, is_function: bool
) -> "Question":
    """Return what is asked; the test fails where that makes no sense."""
    from mjbench.testing import callables, stored

    __tracebackhide__ = True
    if not 0 < confidence < 1:
        raise _failure(f"confidence must be between 0 and 1, not {confidence!r}")
    if not time_limit_s > 0:
        raise _failure(f"time_limit_s must be above 0, not {time_limit_s!r}")
    least = (callables if is_function else stored).least_slowdown(confidence)
    if not max_slowdown >= least:
        why = (
            "identical functions can differ by nearly as much from process to process"
            if is_function
            else "a stored time decides no less; give the old function as the baseline"
        )
        raise _failure(f"max_slowdown must be at least {least:.3g}, not {max_slowdown!r}: {why}")
    return callables.Question(max_slowdown, confidence, time_limit_s)


def _are_disabled(config: pytest.Config) -> bool:
    """Return whether an option of pytest-benchmark says that nothing is to be timed."""
    is_disabled = config.getoption("benchmark_disable", False)
    is_enabled = config.getoption("benchmark_enable", False)
    return bool(is_disabled and not is_enabled) or bool(config.getoption("benchmark_skip", False))


def _stored_file(config: pytest.Config, baseline: Path) -> Path | None:
    """Return the file that a path or a name of pytest-benchmark's storage names, the newest.

    A path is relative to the current folder, or to the folder of the project.
    """
    for folder in (Path.cwd(), config.rootpath):
        if (folder / baseline).is_file():
            return folder / baseline
    storage = str(config.getoption("benchmark_storage")).removeprefix("file://")
    if baseline.parent != Path() or "://" in storage:
        return None
    saved = [
        file
        for file in Path(storage).glob("*/*.json")
        if baseline.stem in (file.stem, file.stem.partition("_")[2])
    ]
    return max(saved, key=lambda file: file.name, default=None)


def _inconclusive(question: "Question", detail: str) -> SpeedCheck:
    return SpeedCheck(
        Answer.INCONCLUSIVE, question.max_slowdown, question.confidence, detail=detail
    )


def _failure(reason: str) -> BaseException:
    """Return the exception that fails a test in one line, without a traceback."""
    return pytest.fail.Exception(f"mjbench: {reason}", pytrace=False)


def _nothing() -> None:
    pass
