"""The tables of trials: nothing is cut off, and what is unknown is empty."""

from dataclasses import replace

import pytest

from benchmarks.verdicts import section
from benchmarks.verdicts.records import Arm, CaseSummary
from mjbench.results import terminal

KNOWN = CaseSummary(
    old="4.0.0",
    new="4.0.0",
    model="quadruped_terrain",
    slowdown=0.005,
    averaged=True,
    trials=20,
    detected=0.5,
    wrong=0.0,
    by_code=None,
    by_placement=None,
    measured=0.0045,
    missed=0.5,
    inconclusive=0.0,
    covered=1.0,
    error=-0.001,
    seconds=12.34,
    launches=15.0,
    launch_sd=0.004,
)
INSIDE = replace(
    KNOWN,
    arm=Arm.INSIDE_STEP,
    slowdown=None,
    callback="mj_subtreeVel",
    covered=None,
    error=None,
    launch_sd=None,
)
BUILDS = replace(
    KNOWN,
    arm=Arm.BETWEEN_BUILDS,
    slowdown=0.0,
    old="3.2.1",
    new="3.2.2",
    wrong=0.15,
    by_code=0.15,
    by_placement=0.25,
)


def printed(*rows: CaseSummary) -> list[str]:
    return terminal.text_of([section.section(rows, 0.99)]).splitlines()


@pytest.mark.parametrize(
    ("row", "cells"),
    [
        (
            KNOWN,
            "0.5 % averaged 20 +0.45 % 50.0 % 0.0 % 50.0 % 0.0 % 100.0 % -0.100 % 12.3 15.0 0.40 %",
        ),
        (INSIDE, "calls mj_subtreeVel averaged 20 +0.45 % 50.0 % 0.0 % 50.0 % 0.0 % 12.3 15.0"),
        (
            BUILDS,
            "3.2.1 → 3.2.2 averaged 20 15.0 % 15.0 % 25.0 % 0.0 % 100.0 % -0.100 %"
            " 12.3 15.0 0.40 %",
        ),
    ],
)
def test_a_row_says_what_differed_and_what_was_found(row: CaseSummary, cells: str) -> None:
    lines = printed(row)
    assert " ".join(lines[-1].split()) == f"quadruped_terrain {cells}"


def test_what_is_too_small_to_matter_is_not_missed_and_said() -> None:
    lines = printed(replace(KNOWN, missed=None), BUILDS)
    assert "of less than 1 % (--min-effect) may be called the same" in lines[-1]


def test_the_first_line_says_whether_to_trust_verdicts_here() -> None:
    assert printed(KNOWN)[0] == "0 of 20 verdicts on known truths are wrong"
    many = replace(KNOWN, trials=200)
    assert printed(many)[0].endswith("wrong: trust `versions` and `ab` on this machine")
    assert "do not trust them here; `mjbench doctor`" in printed(replace(KNOWN, wrong=0.2))[0]


def test_builds_have_a_table_of_their_own() -> None:
    lines = printed(KNOWN, BUILDS)
    (slowdowns, builds) = (line for line in lines if line.startswith("model"))
    assert "called slower" in slowdowns and "by code" not in slowdowns
    assert "by code" in builds and "only as shipped" in builds


def test_a_line_says_once_why_trials_are_as_shipped() -> None:
    row = replace(KNOWN, averaged=False, problem="MuJoCo 4.0.0: no installer recorded MuJoCo")
    lines = printed(row, replace(row, slowdown=0.0))
    assert [line for line in lines if "compared as shipped" in line] == [
        "compared as shipped: MuJoCo 4.0.0: no installer recorded MuJoCo"
    ]
    assert sum("as shipped" in line for line in lines) == 3
