"""The fixture `mjbench` in projects of their own, as pytest runs them."""

from pathlib import Path

import pytest
from pytest_runs import PLUGIN, run_pytest

from mjbench.testing import fixture

# Work whose time is far from that of other numbers, so that a busy machine does not matter.
FUNCTIONS = """
def work(number):
    return lambda: sum(range(number))

"""


def test_functions_are_compared(tmp_path: Path) -> None:
    done = run_pytest(
        tmp_path,
        FUNCTIONS
        + """
def test_faster(mjbench):
    check = mjbench.not_slower(work(1000), baseline=work(9000))
    assert check.ratio.estimate < 0.5

def test_slower(mjbench):
    mjbench.not_slower(work(9000), baseline=work(1000))

def test_other_work(mjbench):
    mjbench.not_slower(work(10), baseline=work(20), check=lambda a, b: a == b)

def test_same_work(mjbench):
    mjbench.not_slower(work(1000), lambda: (work(9000)(), work(1000)())[1], check=int.__eq__)

def test_wrong_share(mjbench):
    mjbench.not_slower(work(10), work(10), max_slowdown=0.001)

def test_wrong_file(mjbench):
    mjbench.not_slower(work(10), "no.json")

def test_no_function(mjbench):
    mjbench.not_slower(3, work(10))

def test_an_exception_of_the_function(mjbench):
    mjbench.not_slower(lambda: 1 / 0, work(10))
""",
    )
    assert done.returncode == 1
    assert "6 failed, 2 passed" in done.stdout
    for line in (
        "mjbench: slower: +",
        "mjbench: the function returns something else than its baseline",
        "not 0.001: identical functions can differ by nearly as much from process",
        "mjbench: the baseline must be a function; with times that were stored, pytest-benchmark",
        "mjbench: not_slower needs a function to judge",
        "ZeroDivisionError",
    ):
        assert line in done.stdout, line
    assert "fixture.py" not in done.stdout  # no traceback into mjbench


def test_the_fixture_works_without_pytest_benchmark(tmp_path: Path) -> None:
    content = FUNCTIONS
    content += "def test_it(mjbench):\n    mjbench.not_slower(work(1000), work(9000))\n"
    done = run_pytest(tmp_path, content, plugins=(PLUGIN,))
    assert "1 passed" in done.stdout


def test_where_benchmarks_are_disabled_functions_run_once(tmp_path: Path) -> None:
    content = (
        FUNCTIONS
        + """
calls = []

def test_it(mjbench):
    mjbench.not_slower(lambda: calls.append(1), work(9000))

def test_calls():
    assert calls == [1]
"""
    )
    done = run_pytest(tmp_path, content, "--benchmark-disable")
    assert "1 passed, 1 skipped in" in done.stdout  # and no warning
    assert "benchmarks are disabled" in done.stdout


def test_tests_that_do_not_use_the_fixture_pay_nothing_for_it(tmp_path: Path) -> None:
    content = """
import sys

def test_it():
    heavy = {"numpy", "mujoco", "rich", "scipy", "msgspec", "mjbench.testing.fixture"}
    assert not heavy & set(sys.modules)
    assert "mjbench.testing" in sys.modules
"""
    done = run_pytest(tmp_path, content, plugins=(PLUGIN,))
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("confidence", "time_limit_s", "message"),
    [
        (1.0, 30.0, "confidence must be above 0 and below 1, such as 0.01 for 1 %, not"),
        (0.95, 0.0, "time_limit_s must be above 0 and at most 86400, a day in seconds, not"),
        (0.95, float("nan"), "time_limit_s must be above 0 and at most 86400"),
    ],
)
def test_arguments_are_within_the_bounds_of_commands(
    confidence: float, time_limit_s: float, message: str
) -> None:
    with pytest.raises(pytest.fail.Exception, match=f"^mjbench: {message}"):
        fixture._question(0.1, confidence, time_limit_s)
