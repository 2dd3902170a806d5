"""The fixture `mjbench` in projects of their own, as pytest runs them."""

import json
from pathlib import Path

import pytest
from pytest_runs import PLUGIN, run_pytest

# Work whose time is far from that of other numbers, so that a busy machine does not matter.
FUNCTIONS = """
def work(number):
    return lambda: sum(range(number))

"""
STORED = FUNCTIONS + "def test_it(mjbench):\n    mjbench.not_slower(work(NUMBER), 'main.json')\n"


def test_functions_are_compared(tmp_path: Path) -> None:
    done = run_pytest(
        tmp_path,
        FUNCTIONS
        + """
def test_faster(mjbench):
    check = mjbench.not_slower(work(1000), baseline=work(9000))
    assert check.ratio < 0.5

def test_slower(mjbench):
    mjbench.not_slower(work(9000), baseline=work(1000))

def test_other_work(mjbench):
    mjbench.not_slower(work(10), baseline=work(20), check=lambda a, b: a == b)

def test_same_work(mjbench):
    mjbench.not_slower(work(1000), lambda: (work(9000)(), work(1000)())[1], check=int.__eq__)

def test_wrong_share(mjbench):
    mjbench.not_slower(work(10), work(10), max_slowdown=0.001)

def test_wrong_file(mjbench):
    mjbench.not_slower(work(10), "no.json", check=int.__eq__)

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
        "mjbench: check needs a baseline that is a function",
        "mjbench: not_slower needs a function to judge",
        "ZeroDivisionError",
    ):
        assert line in done.stdout, line
    assert "fixture.py" not in done.stdout  # no traceback into mjbench


def test_a_saved_time_is_a_baseline_of_later_runs(tmp_path: Path) -> None:
    first = run_pytest(tmp_path, STORED.replace("NUMBER", "3000"), "--benchmark-save=main")
    assert first.returncode == 0, first.stdout
    assert "there is no main.json yet, and this run saves its times" in first.stdout
    (file,) = tmp_path.glob(".benchmarks/*/0001_main.json")
    (entry,) = json.loads(file.read_text())["benchmarks"]
    assert set(entry["extra_info"]["mjbench"]) == {
        *("calibrators", "cpu", "compute_log_ratios", "memory_log_ratios")
    }
    assert entry["stats"]["median"] > 0
    faster = run_pytest(tmp_path, STORED.replace("NUMBER", "300"))
    assert faster.returncode == 0, faster.stdout
    assert "1 passed" in faster.stdout
    slower = run_pytest(tmp_path, STORED.replace("NUMBER", "30000"), "--benchmark-json=main.json")
    assert slower.returncode == 1
    assert "mjbench: slower: +" in slower.stdout
    elsewhere = json.loads((tmp_path / "main.json").read_text())
    elsewhere["machine_info"]["node"] = "elsewhere"
    (tmp_path / "main.json").write_text(json.dumps(elsewhere))
    other = run_pytest(tmp_path, STORED.replace("NUMBER", "300"))
    assert other.returncode == 0
    assert "1 skipped" in other.stdout
    assert "the baseline is of another machine or Python (node elsewhere" in other.stdout
    strict = STORED.replace("'main.json'", "'main.json', allow_inconclusive=False")
    assert run_pytest(tmp_path, strict.replace("NUMBER", "300")).returncode == 1


def test_a_missing_or_broken_baseline_fails_in_a_line(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, STORED.replace("NUMBER", "10"))
    assert done.returncode == 1
    assert "mjbench: no stored baseline main.json: save one" in done.stdout
    assert "pytest --benchmark-save=main" in done.stdout
    (tmp_path / "main.json").write_text("{")
    done = run_pytest(tmp_path, STORED.replace("NUMBER", "10"))
    assert done.returncode == 1
    assert "main.json is no file of pytest-benchmark" in done.stdout
    assert "Traceback" not in done.stdout


def test_without_pytest_benchmark_only_a_stored_baseline_needs_it(tmp_path: Path) -> None:
    content = STORED.replace("NUMBER", "10")
    content += "def test_two(mjbench):\n    mjbench.not_slower(work(1000), work(9000))\n"
    done = run_pytest(tmp_path, content, plugins=(PLUGIN,))
    assert "1 failed, 1 passed" in done.stdout
    assert "mjbench: a stored baseline needs pytest-benchmark: python -m pip install" in done.stdout


@pytest.mark.parametrize("baseline", ["work(9000)", "'main.json'"])
def test_where_benchmarks_are_disabled_functions_run_once(tmp_path: Path, baseline: str) -> None:
    content = (
        FUNCTIONS
        + f"""
calls = []

def test_it(mjbench):
    mjbench.not_slower(lambda: calls.append(1), {baseline})

def test_calls():
    assert calls == [1]
"""
    )
    done = run_pytest(tmp_path, content, "--benchmark-disable")
    assert "1 passed, 1 skipped in" in done.stdout  # and no warning
    assert "benchmarks are disabled" in done.stdout


def test_one_test_times_one_function_for_a_file(tmp_path: Path) -> None:
    content = """
def test_it(mjbench, benchmark):
    benchmark(int)
    mjbench.not_slower(int, "main.json")
"""
    done = run_pytest(tmp_path, content, "--benchmark-json=main.json")
    assert "mjbench: a test can time one function for a file" in done.stdout


def test_packages_that_are_missing_are_named(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("import sys\nsys.modules['scipy'] = None\n")
    done = run_pytest(tmp_path, STORED.replace("NUMBER", "10"))
    assert done.returncode == 1
    assert "mjbench: the fixture mjbench needs scipy: python -m pip install" in done.stdout


def test_tests_that_do_not_use_the_fixture_pay_nothing_for_it(tmp_path: Path) -> None:
    content = """
import sys

def test_it():
    heavy = {"numpy", "mujoco", "rich", "scipy", "msgspec", "mjbench.testing.fixture"}
    assert not heavy & set(sys.modules)
    assert "mjbench.testing.plugin" in sys.modules
"""
    done = run_pytest(tmp_path, content, plugins=(PLUGIN,))
    assert done.returncode == 0, done.stdout
