"""Selfcheck: slowdowns that are possible, and what its trials say."""

import os
from pathlib import Path

import numpy as np
import process_tree
import pytest
from paired_examples import CARTPOLE

from mjbench.errors import InputError
from mjbench.paired import selfcheck
from mjbench.paired.outcomes import Verdict
from mjbench.paired.preparation import Sizes
from mjbench.paired.records import TrialRecord
from mjbench.paired.selfcheck import Case
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource


def trial(verdict: Verdict, slowdown: float, estimate: float, half_width: float) -> TrialRecord:
    low, high = estimate - half_width, estimate + half_width
    return TrialRecord("m", slowdown, verdict, estimate, low, high, 2.0, [0.01, 0.03])


@pytest.mark.parametrize(
    ("slowdown", "nbatch"), [(0.0, None), (0.005, 200), (0.01, 100), (0.05, 20), (0.5, 2)]
)
def test_a_slowdown_is_a_whole_number_of_simulations(slowdown: float, nbatch: int | None) -> None:
    assert Case.create(CARTPOLE.model, slowdown).sizes == Sizes(nbatch=nbatch)


@pytest.mark.parametrize("slowdown", [0.003, -0.01, 1e-6])
def test_a_slowdown_that_is_no_whole_number_of_simulations_is_bad_input(slowdown: float) -> None:
    with pytest.raises(InputError, match="must be a whole number"):
        Case.create(CARTPOLE.model, slowdown)


def test_a_summary_has_a_row_for_each_model_and_slowdown() -> None:
    trials = [
        trial(Verdict.SAME, 0.0, 1.0, 0.002),
        trial(Verdict.SLOWER, 0.0, 1.004, 0.002),
        trial(Verdict.SLOWER, 0.02, 1.02, 0.005),
        trial(Verdict.FASTER, 0.02, 0.98, 0.005),
        trial(Verdict.SAME, 0.02, 1.0, 0.005),
        trial(Verdict.INCONCLUSIVE, 0.02, 1.024, 0.005),
    ]
    none, slowed = selfcheck.summary(trials)
    assert (none.slowdown, none.trials, none.detected, none.wrong) == (0.0, 2, 0.5, 0.5)
    assert (none.missed, none.covered) == (0.0, 0.5)
    assert (slowed.slowdown, slowed.trials, slowed.detected, slowed.wrong) == (0.02, 4, 0.25, 0.25)
    assert (slowed.missed, slowed.inconclusive, slowed.covered) == (0.25, 0.25, 0.5)
    assert slowed.error == pytest.approx(np.mean([0.0, -0.04, -0.02, 0.004]))
    assert (slowed.seconds, slowed.launches) == (2.0, 2.0)
    assert slowed.launch_sd == pytest.approx(np.std([0.01, 0.03], ddof=1))


def test_a_model_that_fails_costs_only_its_own_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = Case(ModelSource("broken", Path("broken.xml")), 0.0, Sizes())
    sound = Case(CARTPOLE.model, 0.0, Sizes())
    tried, done, failed = [], [], []

    def try_once(pool: WorkerPool, case: Case, plan: VerdictPlan) -> TrialRecord:
        tried.append(case)
        if case is broken:
            raise InputError("its timestep is 0 s")
        return trial(Verdict.SAME, 0.0, 1.0, 0.002)

    monkeypatch.setattr(selfcheck, "trial", try_once)
    with WorkerPool() as pool:
        selfcheck.run(
            *(pool, [broken, sound] * 3, VerdictPlan(), done.append),
            lambda model, error: failed.append((model.name, str(error))),
        )
    assert tried == [broken, sound, sound, sound]
    assert len(done) == 3
    assert failed == [("broken", "its timestep is 0 s")]


def test_a_trial_with_too_few_launches_has_no_interval_and_covers_the_truth() -> None:
    record = TrialRecord("m", 0.0, Verdict.INCONCLUSIVE, 1.5, None, None, 1.0, [0.4])
    (row,) = selfcheck.summary([record])
    assert row.covered == 1.0
    assert row.launch_sd is None


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="no affinity on this system")
def test_the_process_that_keeps_a_core_busy_is_out_of_reach_of_ctrl_c_and_ends() -> None:
    before = process_tree.descendants()
    with selfcheck.busy_neighbour_core():
        (pid,) = process_tree.descendants() - before
        assert os.getsid(pid) == pid  # a terminal sends Ctrl-C to its own session
    assert process_tree.descendants() <= before
