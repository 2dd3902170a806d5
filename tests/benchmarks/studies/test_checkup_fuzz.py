"""The fuzz of the check-up draws the same programs for a seed, and notices what is wrong."""

import itertools

import pytest

from benchmarks.studies import checkup_fuzz


def test_a_seed_draws_the_same_programs() -> None:
    first, second = (list(itertools.islice(checkup_fuzz.programs(7), 200)) for _ in range(2))
    assert first == second
    assert len(set(first)) > 150


@pytest.mark.parametrize(
    ("expected", "code", "err", "problem"),
    [
        (3, 3, "it ended with exit code 3", ""),
        (0, 3, "", "exit code 3 in place of 0"),
        (3, 3, "mjbench: unexpected KeyError", "an error of mjbench's own"),
        (1, 1, 'File "/x/mjbench/commands/run/driver.py", line 3', "a traceback of mjbench"),
    ],
)
def test_what_is_wrong_is_named(expected: int, code: int, err: str, problem: str) -> None:
    assert checkup_fuzz.judge(expected, code, err) == problem
