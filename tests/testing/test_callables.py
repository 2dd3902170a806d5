"""Two functions in turns, on a clock that they turn themselves."""

import math
import random
from collections.abc import Callable

import pytest

from mjbench.interval import Interval
from mjbench.testing import callables
from mjbench.testing.callables import Answer, FunctionPair, SpeedCheck, SpeedQuestion

QUESTION = SpeedQuestion(max_slowdown=0.1, confidence=0.99, time_limit_s=10.0)


class Machine:
    """A clock, and functions whose calls take a time that the test gives."""

    def __init__(self, seed: int = 1) -> None:
        self.now = 0.0
        self.setups = 0
        self.noise = random.Random(seed)

    def clock(self) -> float:
        return self.now

    def function(self, seconds: Callable[[], float]) -> Callable[[], None]:
        def call() -> None:
            self.now += seconds()

        return call

    def noisy(self, seconds: float, sd: float) -> Callable[[], None]:
        return self.function(lambda: seconds * math.exp(self.noise.gauss(0.0, sd)))

    def setup(self) -> None:
        self.setups += 1
        self.now += 100.0  # never timed

    def compare(
        self,
        baseline: Callable[[], None],
        candidate: Callable[[], None],
        question: SpeedQuestion = QUESTION,
        setup: Callable[[], object] | None = None,
    ) -> SpeedCheck:
        pair = FunctionPair(baseline, candidate, setup or (lambda: None))
        return callables.compare(pair, question, self.clock, random.Random(2))


@pytest.mark.parametrize(
    ("slowdown", "expected"), [(0.5, Answer.SLOWER), (0.2, Answer.SLOWER), (0.0, Answer.NOT_SLOWER)]
)
def test_a_change_is_judged_by_the_slowdown_that_is_allowed(
    slowdown: float, expected: Answer
) -> None:
    machine = Machine()
    check = machine.compare(machine.noisy(1e-3, 0.05), machine.noisy(1e-3 * (1 + slowdown), 0.05))
    assert check.answer == expected
    assert check.ratio is not None
    assert check.ratio.estimate == pytest.approx(1 + slowdown, rel=0.02)
    assert check.ratio.low is not None and check.ratio.high is not None
    assert check.ratio.low < 1 + slowdown < check.ratio.high
    assert check.candidate_s == pytest.approx(1e-3 * (1 + slowdown), rel=0.02)
    assert check.baseline_s == pytest.approx(1e-3, rel=0.02)
    assert check.rounds >= callables.LEAST_ROUNDS
    assert not check.detail


def test_the_interval_allows_for_what_differs_from_process_to_process() -> None:
    machine = Machine()
    function = machine.function(lambda: 1e-3)
    check = machine.compare(function, function)
    assert check.ratio is not None and check.ratio.high is not None
    assert check.ratio.high - 1 == pytest.approx(callables.least_slowdown(0.99), rel=1e-6)


def test_a_change_near_the_limit_is_inconclusive_as_soon_as_more_rounds_are_of_no_use() -> None:
    machine = Machine()
    check = machine.compare(machine.noisy(1e-3, 0.05), machine.noisy(1.1e-3, 0.05))
    assert check.answer == Answer.INCONCLUSIVE
    assert "from process to process" in check.detail
    assert machine.now < 0.5 * QUESTION.time_limit_s


def test_noise_is_inconclusive_when_time_is_up() -> None:
    machine = Machine()
    check = machine.compare(machine.noisy(1e-3, 2.0), machine.noisy(1e-3, 2.0))
    assert check.answer == Answer.INCONCLUSIVE
    assert "not certain within 10 s" in check.detail
    assert machine.now <= QUESTION.time_limit_s + 1.0


def test_functions_that_are_too_slow_are_not_judged_by_a_few_rounds() -> None:
    machine = Machine()
    slow = machine.function(lambda: 1.0)
    check = machine.compare(slow, machine.function(lambda: 3.0))
    assert check.answer == Answer.INCONCLUSIVE
    assert check.rounds < callables.LEAST_ROUNDS
    assert "rounds fit into 10 s" in check.detail


def test_a_machine_that_gets_slower_hits_both_functions_alike() -> None:
    machine = Machine()
    drifting = machine.function(lambda: 1e-3 * (1 + machine.now))
    check = machine.compare(drifting, drifting)
    assert check.answer == Answer.NOT_SLOWER
    assert check.ratio is not None
    assert check.ratio.estimate == pytest.approx(1.0, abs=0.01)


def test_pauses_of_other_processes_do_not_make_a_function_slower() -> None:
    machine = Machine()

    def seconds() -> float:
        return 1e-3 + (0.01 if machine.noise.random() < 0.05 else 0.0)

    check = machine.compare(machine.function(seconds), machine.function(seconds))
    assert check.answer == Answer.NOT_SLOWER


def test_the_set_up_runs_before_each_block_and_is_not_timed() -> None:
    machine = Machine()
    function = machine.function(lambda: 1e-3)
    question = SpeedQuestion(0.1, 0.99, 1e9)
    check = machine.compare(function, function, question, machine.setup)
    assert check.candidate_s == pytest.approx(1e-3)
    assert machine.setups >= 4 * check.rounds


def test_identical_functions_are_hardly_ever_called_slower() -> None:
    answers = []
    for seed in range(100):
        machine = Machine(seed)
        function = machine.noisy(1e-3, 0.1)
        answers.append(machine.compare(function, function, SpeedQuestion(0.1, 0.99, 3.0)).answer)
    assert answers.count(Answer.SLOWER) <= 2
    assert answers.count(Answer.NOT_SLOWER) > 10


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ((-0.5, -0.1), Answer.NOT_SLOWER),
        ((-0.01, math.log1p(0.05)), Answer.NOT_SLOWER),
        ((0.01, 0.06), Answer.INCONCLUSIVE),
        ((None, None), Answer.INCONCLUSIVE),
        ((math.log1p(0.05), 0.06), Answer.INCONCLUSIVE),
        ((0.05, 0.06), Answer.SLOWER),
    ],
)
def test_only_an_interval_on_one_side_of_the_limit_decides(
    ends: tuple[float | None, float | None], expected: Answer
) -> None:
    assert callables.of_interval(Interval(0.0, *ends), math.log1p(0.05)) == expected


def test_an_answer_is_a_line_with_its_figures() -> None:
    check = SpeedCheck(Answer.SLOWER, 0.05, 0.99, Interval(1.12, 1.10, 1.14), 2.5e-5, 2.2e-5, 9)
    assert str(check) == (
        "slower: +12.0 % (interval +10.0 to +14.0 %, 5 % allowed), 25 µs a call, baseline 22 µs"
    )


def test_without_figures_the_reason_stands_alone() -> None:
    check = SpeedCheck(Answer.INCONCLUSIVE, 0.05, 0.99, detail="benchmarks are disabled")
    assert str(check) == "inconclusive: benchmarks are disabled"
