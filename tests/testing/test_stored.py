"""A function against its time on an earlier occasion: what is refused, and what decides."""

import dataclasses
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.instrument import machine
from mjbench.testing import calibrator, stored
from mjbench.testing.answer import Answer
from mjbench.testing.callables import Question
from mjbench.testing.stored import Occasion, SavedBenchmark, SavedMachine, SavedRun

QUESTION = Question(max_slowdown=0.25, confidence=0.99, time_limit_s=10.0)
TEST = "tests/test_speed.py::test_env"


def occasion(compute: float = 0.0, memory: float = 0.0, spread: float = 0.001) -> Occasion:
    """Return an occasion with log ratios around two values."""
    steps = spread * np.linspace(-1, 1, stored.GROUPS)
    logs = [(value + steps).tolist() for value in (compute, memory)]
    return Occasion(calibrator.VERSION, machine.cpu_name(), *logs)


def saved(entry: object, **changes: Any) -> SavedRun:
    here = dataclasses.replace(SavedMachine.here(), **changes)
    return SavedRun(here, [SavedBenchmark(TEST, {} if entry is None else {stored.KEY: entry})])


def judge(before: Occasion, now: Occasion) -> Answer:
    return stored.judge(before, now, QUESTION, 1e-3, 100).answer


def test_the_same_on_both_occasions_is_not_slower() -> None:
    check = stored.judge(occasion(), occasion(), QUESTION, 2e-3, 100)
    assert check.answer == Answer.NOT_SLOWER
    assert check.ratio == pytest.approx(1.0)
    assert check.baseline_s == pytest.approx(2e-3)


def test_twice_as_slow_by_both_calibrators_is_slower() -> None:
    twice = math.log(2.0)
    assert judge(occasion(), occasion(twice, twice)) == Answer.SLOWER


@pytest.mark.parametrize(("compute", "memory"), [(math.log(2.0), 0.0), (0.0, math.log(2.0))])
def test_slower_by_one_calibrator_alone_may_be_the_machine(compute: float, memory: float) -> None:
    assert judge(occasion(), occasion(compute, memory)) == Answer.INCONCLUSIVE


def test_a_noisy_occasion_decides_less() -> None:
    slower = math.log(1.6)
    assert judge(occasion(), occasion(slower, slower)) == Answer.SLOWER
    assert judge(occasion(), occasion(slower, slower, spread=0.5)) == Answer.INCONCLUSIVE


def test_the_interval_allows_for_what_differs_between_occasions() -> None:
    check = stored.judge(occasion(), occasion(), QUESTION, 1e-3, 100)
    assert check.low is not None and check.high is not None
    margin = 2.576 * math.sqrt(2) * stored.OCCASION_SPREAD
    assert math.log(check.high) == pytest.approx(margin, rel=1e-3)
    assert math.log(check.low) == pytest.approx(-margin, rel=1e-3)
    assert stored.least_slowdown(0.99) == pytest.approx(math.expm1(margin), rel=1e-3)


def test_a_stored_occasion_is_found() -> None:
    before = stored.find(saved(msgspec.to_builtins(occasion())), TEST)
    assert judge(before, occasion()) == Answer.NOT_SLOWER


@pytest.mark.parametrize(
    ("run", "reason"),
    [
        (saved(None, node="elsewhere"), "another machine or Python (node elsewhere, here"),
        (saved(None, python_version="2.7.18"), "(python_version 2.7.18, here"),
        (dataclasses.replace(saved(None), benchmarks=[]), "has no time of tests/test_speed.py"),
        (saved(None), "has no calibration"),
        (saved({"tea": 1}), "calibration cannot be read"),
        (saved([1, 2]), "calibration cannot be read"),
        (saved({**vars(occasion()), "calibrators": 0}), "another version of mjbench"),
        (saved({**vars(occasion()), "cpu": "a 6502"}), "another processor (a 6502)"),
        (saved({**vars(occasion()), "compute_log_ratios": [0.0]}), "calibration is damaged"),
        (saved({**vars(occasion()), "memory_log_ratios": [math.inf] * 8}), "is damaged"),
    ],
)
def test_what_cannot_be_compared_with_says_why(run: SavedRun, reason: str) -> None:
    with pytest.raises(stored.IncomparableError) as error:
        stored.find(run, TEST)
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"benchmarks": 3}', b"\xff\xfe", b"null"])
def test_a_file_that_is_none_of_pytest_benchmark_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "main.json"
    file.write_bytes(content)
    with pytest.raises(InputError, match="no file of pytest-benchmark"):
        stored.read(file)
    with pytest.raises(InputError, match="cannot read"):
        stored.read(tmp_path)


def test_more_than_is_needed_may_be_in_a_file(tmp_path: Path) -> None:
    value = {
        "machine_info": {**vars(SavedMachine.here()), "cpu": {"brand_raw": "x"}, "release": "6"},
        "benchmarks": [{"fullname": TEST, "extra_info": {}, "stats": {"min": 1.0}}],
        "version": "5.3.1",
    }
    (tmp_path / "main.json").write_text(json.dumps(value))
    assert stored.read(tmp_path / "main.json").benchmarks[0].fullname == TEST


class Benchmark:
    """Times as pytest-benchmark does, on the clock of a test."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.disabled = False
        self.extra_info: dict[str, Any] = {}
        self.stats: Any = SimpleNamespace(stats=SimpleNamespace(data=[]))

    def pedantic(
        self, target: Callable[[], object], *, teardown: Callable[[], object], rounds: int,
        iterations: int,
    ) -> None:  # fmt: skip
        for _ in range(rounds):
            start = self.clock()
            for _ in range(iterations):
                target()
            self.stats.stats.data.append((self.clock() - start) / iterations)
            teardown()


class Machine:
    """A machine whose speed changes, with all that runs on it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, slowness: Callable[[float], float]) -> None:
        self.now = 0.0
        self._slowness = slowness
        monkeypatch.setattr(calibrator, "compute", self.work(2e-4))
        monkeypatch.setattr(calibrator, "copy", self.work(3e-4))

    def clock(self) -> float:
        return self.now

    def work(self, seconds: float) -> Callable[[], None]:
        def call() -> None:
            self.now += seconds * self._slowness(self.now)

        return call

    def occasion(self, seconds: float) -> Occasion:
        benchmark = Benchmark(self.clock)
        measured = stored.measure(benchmark, self.work(seconds), lambda: None, self.clock)
        assert msgspec.convert(benchmark.extra_info[stored.KEY], Occasion) == measured
        return measured


@pytest.mark.parametrize("seconds", [1e-6, 1e-3, 0.5])
def test_a_slower_machine_does_not_make_a_function_slower(
    monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    before = Machine(monkeypatch, lambda now: 1.0).occasion(seconds)
    now = Machine(monkeypatch, lambda now: 1.6 + 0.05 * math.sin(now)).occasion(seconds)
    assert judge(before, now) == Answer.NOT_SLOWER
    slower = Machine(monkeypatch, lambda now: 0.7).occasion(2 * seconds)
    assert judge(before, slower) == Answer.SLOWER


def test_each_round_is_compared_with_the_calibrator_around_it() -> None:
    function_s = [1.0, 2.0, 4.0, 8.0]
    calibrator_s: Sequence[float] = [1.0, 1.0, 4.0, 4.0, 16.0]
    logs = stored.group_log_ratios(function_s, calibrator_s)
    assert logs == pytest.approx([0.0] * 4)


def test_the_calibrators_work() -> None:
    assert calibrator.compute() == calibrator.compute() > 0
    assert calibrator.copy() == 1 << 22
