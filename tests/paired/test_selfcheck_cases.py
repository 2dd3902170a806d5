"""The cases of a selfcheck: what differs in each arm, and which trials remain."""

import pytest
from paired_examples import CARTPOLE, INSTALLED

from mjbench.paired import selfcheck
from mjbench.paired.outcomes import Arm, Verdict
from mjbench.paired.selfcheck import Case
from mjbench.paired.selfcheck_records import CaseRow, TrialRecord
from mjbench.releases.release import NoChangePair

MODEL = CARTPOLE.model
VERSION = INSTALLED.version
PAIR = NoChangePair("3.2.1", "3.2.2")


def done(case: Case) -> TrialRecord:
    return TrialRecord(
        **vars(case.row()),
        verdict=Verdict.SAME,
        estimate=1.0,
        low=None,
        high=None,
        seconds=1.0,
        launches=[0.0],
    )


@pytest.mark.parametrize("slowdown", [0.0, 0.003, 0.01])
def test_only_the_candidate_is_slowed_down(slowdown: float) -> None:
    case = selfcheck.slowed(MODEL, slowdown)
    assert (case.baseline.slowdown, case.candidate.slowdown) == (0.0, slowdown)
    assert case.row().is_slower == (slowdown > 0)


def test_the_size_of_a_slowdown_inside_a_step_is_unknown_and_its_sign_is_known() -> None:
    case = selfcheck.inside_step(MODEL, "mj_factorM")
    assert (case.baseline.callback, case.candidate.callback) == ("", "mj_factorM")
    row = case.row()
    assert row == CaseRow(
        arm=Arm.INSIDE_STEP,
        model="cartpole",
        slowdown=None,
        callback="mj_factorM",
        old=VERSION,
        new=VERSION,
    )
    assert row.is_slower


def test_builds_between_which_nothing_changed_are_the_same() -> None:
    row = selfcheck.between_builds(MODEL, PAIR).row()
    assert (row.arm, row.old, row.new) == (Arm.BETWEEN_BUILDS, "3.2.1", "3.2.2")
    assert (row.slowdown, row.is_slower) == (0.0, False)


def test_only_the_trials_that_are_missing_are_run_in_turns() -> None:
    cases = [
        selfcheck.slowed(MODEL, 0.0),
        selfcheck.slowed(MODEL, 0.01),
        selfcheck.inside_step(MODEL, "mj_factorM"),
        selfcheck.inside_step(MODEL, "mj_energyPos"),
        selfcheck.between_builds(MODEL, PAIR),
        selfcheck.between_builds(MODEL, NoChangePair("3.1.2", "3.1.3")),
    ]
    finished = [0, 0, 2, 4, 4]
    remaining = selfcheck.remaining(cases, 2, [done(cases[i]) for i in finished])
    assert [cases.index(case) for case in remaining] == [1, 3, 5, 1, 2, 3, 5]
