"""What a trial stores, and what trials say."""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import process_tree
import pytest
from paired_examples import CARTPOLE, CUBES, INSTALLED
from verdict_records import launch

from benchmarks.history.speed_series import NoChangePair
from benchmarks.verdicts import trials
from benchmarks.verdicts.records import Arm, CaseRow, CaseSummary, TrialRecord
from benchmarks.verdicts.trials import Case
from mjbench.errors import Failure, InputError, MachineError
from mjbench.interval import Interval
from mjbench.paired import verdict
from mjbench.paired.metrics import Metric
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import Judgement, LaunchRow, PlacementEffect, VerdictRecord
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import AS_SHIPPED, Placement, PlacementPair
from mjbench.status import Status

MOVED = PlacementPair(Placement(16, 32), Placement(48, 0))
BUILDS = {"arm": Arm.BETWEEN_BUILDS, "old": "3.2.1", "new": "3.2.2"}
INSIDE_STEP = {"arm": Arm.INSIDE_STEP, "slowdown": None, "callback": "mj_factorM"}


def trial(verdict: Verdict, estimate: float, half_width: float = 0.005, **others: Any) -> Any:
    """Return a trial of identical targets, but for other values."""
    return TrialRecord(
        **{
            "model": "m",
            "slowdown": 0.0,
            "old": "4.0.0",
            "new": "4.0.0",
            "verdict": verdict,
            "estimate": estimate,
            "low": estimate - half_width,
            "high": estimate + half_width,
            "seconds": 2.0,
            "launches": [0.01, 0.03],
            **others,
        }
    )


def result(
    case: Case,
    control: PlacementControl,
    launches: Sequence[LaunchRow],
    as_shipped: Judgement | None = None,
    status: Status = Status.OK,
    is_judged: bool = True,
) -> VerdictRecord:
    judgement = Judgement(Verdict.SAME, Interval(1.0, 0.999, 1.001), len(launches), True)
    targets = case.baseline, case.candidate
    record = VerdictRecord.of(
        (targets[0].row(), targets[1].row()),
        Metric.TIME,
        Failure(status, ""),
        judgement if is_judged else None,
        launches=launches,
    )
    return verdict.with_placement(record, targets, control, as_shipped)


def test_a_trial_keeps_launches_as_shipped_apart_from_those_it_rests_on() -> None:
    case = trials.between_builds(CARTPOLE.model, NoChangePair("3.2.1", "3.2.2"))
    launches = [launch(0.001, MOVED), launch(0.03, AS_SHIPPED), launch(-0.001, MOVED)]
    as_shipped = Judgement(Verdict.SLOWER, Interval(1.03, 1.02, 1.04), 1, True)
    record = trials.record_of(
        case, result(case, PlacementControl(True), launches, as_shipped=as_shipped)
    )
    assert record.case() == case.row()
    assert record.launches == pytest.approx([0.001, -0.001], abs=1e-6)
    assert record.residues == [48, 48]
    assert record.as_shipped == pytest.approx([0.03], abs=1e-6)
    assert (record.verdict, record.cause) == (Verdict.SAME, Cause.PLACEMENT)
    assert record.averaged


def test_a_trial_of_what_cannot_be_moved_rests_on_its_launches_as_shipped() -> None:
    case = trials.slowed(CARTPOLE.model, 0.0)
    launches = [launch(0.001, AS_SHIPPED), launch(-0.001, AS_SHIPPED)]
    record = trials.record_of(case, result(case, PlacementControl(False, "no libmujoco"), launches))
    assert record.launches == pytest.approx([0.001, -0.001], abs=1e-6)
    assert (record.residues, record.as_shipped) == ([], [])
    assert (record.averaged, record.problem) == (False, "no libmujoco")


@pytest.mark.parametrize(
    ("others", "error"),
    [
        ({"status": Status.INPUT}, InputError),
        ({"status": Status.FAILED}, MachineError),
        ({"is_judged": False}, MachineError),
        ({"status": Status.INTERRUPTED}, KeyboardInterrupt),
    ],
)
def test_a_comparison_that_did_not_end_well_is_no_trial(
    others: dict[str, Any], error: type[BaseException]
) -> None:
    case = trials.slowed(CARTPOLE.model, 0.0)
    with pytest.raises(error):
        trials.record_of(case, result(case, PlacementControl(True), [], **others))


def test_a_summary_has_a_row_for_each_model_and_slowdown() -> None:
    all_trials = [
        trial(Verdict.SAME, 1.0, 0.002),
        trial(Verdict.SLOWER, 1.004, 0.002),
        trial(Verdict.SLOWER, 1.02, slowdown=0.02),
        trial(Verdict.FASTER, 0.98, slowdown=0.02),
        trial(Verdict.SAME, 1.0, slowdown=0.02),
        trial(Verdict.INCONCLUSIVE, 1.024, slowdown=0.02),
    ]
    none, slowed = trials.summary(all_trials)
    assert (none.slowdown, none.trials, none.detected, none.wrong) == (0.0, 2, 0.5, 0.5)
    assert (none.missed, none.covered) == (None, 0.5)
    assert (slowed.slowdown, slowed.trials, slowed.detected, slowed.wrong) == (0.02, 4, 0.25, 0.25)
    assert (slowed.missed, slowed.inconclusive, slowed.covered) == (0.25, 0.25, 0.5)
    assert slowed.error == pytest.approx(np.mean([0.0, -0.04, -0.02, 0.004]))
    assert (slowed.seconds, slowed.launches) == (2.0, 2.0)
    assert slowed.launch_sd == pytest.approx(np.std([0.01, 0.03], ddof=1))


def test_where_only_the_sign_is_known_there_is_no_error_and_no_coverage() -> None:
    verdicts = (Verdict.SLOWER, Verdict.SLOWER, Verdict.SAME, Verdict.FASTER)
    (row,) = trials.summary([trial(verdict, 1.03, **INSIDE_STEP) for verdict in verdicts])
    assert (row.arm, row.slowdown, row.callback) == (Arm.INSIDE_STEP, None, "mj_factorM")
    assert (row.detected, row.missed, row.wrong) == (0.5, 0.25, 0.25)
    assert row.measured == pytest.approx(0.03)
    assert (row.error, row.covered, row.by_code, row.by_placement) == (None, None, None, None)


def test_a_slowdown_that_measures_less_than_the_smallest_effect_is_not_missed() -> None:
    small = [trial(Verdict.SAME, 1.002, **INSIDE_STEP) for _ in range(3)]
    (row,) = trials.summary(small)
    assert (row.measured, row.missed) == (pytest.approx(0.002), None)
    (row,) = trials.summary(small, min_effect=0.001)
    assert row.missed == 1.0


def test_differences_between_builds_are_counted_by_their_cause() -> None:
    averaged = {**BUILDS, "placement": PlacementEffect(True)}
    (row,) = trials.summary(
        [
            trial(Verdict.SLOWER, 1.02, cause=Cause.CODE, **averaged),
            trial(Verdict.SAME, 1.0, cause=Cause.PLACEMENT, **averaged),
            trial(Verdict.SAME, 1.0, **averaged),
            trial(Verdict.INCONCLUSIVE, 1.0, cause=Cause.UNDECIDED, **averaged),
        ]
    )
    assert (row.old, row.new, row.averaged) == ("3.2.1", "3.2.2", True)
    assert (row.wrong, row.by_code, row.by_placement) == (0.25, 0.25, 0.25)
    assert (row.covered, row.missed) == (0.75, None)


def test_trials_as_shipped_have_a_row_of_their_own_without_a_cause() -> None:
    problem = "MuJoCo 3.2.1: its package holds no libmujoco"
    moved, shipped = trials.summary(
        [
            trial(Verdict.SAME, 1.0, placement=PlacementEffect(True), **BUILDS),
            trial(Verdict.SLOWER, 1.02, placement=PlacementEffect(False, problem), **BUILDS),
        ]
    )
    assert (moved.averaged, moved.by_code, moved.problem) == (True, 0.0, "")
    assert (shipped.averaged, shipped.by_code, shipped.problem) == (False, None, problem)
    assert shipped.wrong == 1.0


def test_rows_are_sorted_by_arm_model_and_slowdown() -> None:
    all_trials = [
        trial(Verdict.SAME, 1.0, **BUILDS),
        trial(Verdict.SAME, 1.0, **{**BUILDS, "old": "3.1.2"}),
        trial(Verdict.SAME, 1.0, **INSIDE_STEP),
        trial(Verdict.SAME, 1.0, slowdown=0.02),
        trial(Verdict.SAME, 1.0),
        trial(Verdict.SAME, 1.0, slowdown=0.05, model="a"),
    ]

    def key(row: CaseSummary) -> tuple[Any, ...]:
        return row.arm, row.model, row.slowdown, row.old

    assert [key(row) for row in trials.summary(all_trials)] == [
        (Arm.SLOWDOWN, "a", 0.05, "4.0.0"),
        (Arm.SLOWDOWN, "m", 0.0, "4.0.0"),
        (Arm.SLOWDOWN, "m", 0.02, "4.0.0"),
        (Arm.INSIDE_STEP, "m", None, "4.0.0"),
        (Arm.BETWEEN_BUILDS, "m", 0.0, "3.2.1"),
        (Arm.BETWEEN_BUILDS, "m", 0.0, "3.1.2"),
    ]


def test_what_fails_costs_only_its_own_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = trials.inside_step(CUBES.model, "mj_factorM")
    broken_too = replace(broken)
    sound = [
        trials.inside_step(CUBES.model, "mj_energyPos"),
        trials.inside_step(CARTPOLE.model, "mj_factorM"),
    ]
    tried = []

    def try_once(pool: WorkerPool, case: Case, plan: VerdictPlan) -> TrialRecord:
        tried.append(case)
        if case is broken:
            raise InputError("it has no such function")
        return trial(Verdict.SAME, 1.0)

    monkeypatch.setattr(trials, "trial", try_once)
    with WorkerPool() as pool:
        ended = list(trials.run(pool, [broken, broken_too, *sound] * 2, VerdictPlan()))
    assert tried == [broken, *sound, *sound]
    assert ended[0] == (broken.row(), Failure(Status.INPUT, "it has no such function"))
    assert all(isinstance(each, TrialRecord) for _, each in ended[1:])
    assert len(ended) == 5


def test_a_model_that_fails_is_not_tried_again_with_another_slowdown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cases = [trials.slowed(CARTPOLE.model, slowdown) for slowdown in (0.0, 0.01)]
    tried = []

    def fail(pool: WorkerPool, case: Case, plan: VerdictPlan) -> TrialRecord:
        tried.append(case)
        raise InputError("its timestep is 0 s")

    monkeypatch.setattr(trials, "trial", fail)
    with WorkerPool() as pool:
        assert len(list(trials.run(pool, cases, VerdictPlan()))) == 1
    assert tried == cases[:1]


def test_a_trial_with_too_few_launches_has_no_interval_and_covers_the_truth() -> None:
    record = trial(Verdict.INCONCLUSIVE, 1.5, low=None, high=None, launches=[0.4])
    (row,) = trials.summary([record])
    assert row.covered == 1.0
    assert row.launch_sd is None


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="no affinity on this system")
def test_the_process_that_keeps_a_core_busy_is_out_of_reach_of_ctrl_c_and_ends() -> None:
    before = process_tree.descendants()
    with trials.busy_neighbour_core():
        (pid,) = process_tree.descendants() - before
        assert os.getsid(pid) == pid  # a terminal sends Ctrl-C to its own session
    assert process_tree.descendants() <= before


MODEL = CARTPOLE.model
VERSION = INSTALLED.version
PAIR = NoChangePair("3.2.1", "3.2.2")


def done(case: Case) -> TrialRecord:
    return trial(Verdict.SAME, 1.0, **vars(case.row()))


@pytest.mark.parametrize("slowdown", [0.0, 0.003, 0.01])
def test_only_the_candidate_is_slowed_down(slowdown: float) -> None:
    case = trials.slowed(MODEL, slowdown)
    assert case.baseline.prepare_run is None
    assert (case.candidate.prepare_run is not None) == (slowdown > 0)
    assert case.row().is_slower == (slowdown > 0)


def test_the_size_of_a_slowdown_inside_a_step_is_unknown_and_its_sign_is_known() -> None:
    case = trials.inside_step(MODEL, "mj_factorM")
    assert case.baseline.prepare_run is None
    assert case.candidate.prepare_run is not None
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


def test_only_the_trials_that_are_missing_are_run_in_turns() -> None:
    cases = [
        trials.slowed(MODEL, 0.0),
        trials.slowed(MODEL, 0.01),
        trials.inside_step(MODEL, "mj_factorM"),
        trials.inside_step(MODEL, "mj_energyPos"),
        trials.between_builds(MODEL, PAIR),
        trials.between_builds(MODEL, NoChangePair("3.1.2", "3.1.3")),
    ]
    finished = [0, 0, 2, 4, 4]
    remaining = trials.remaining(cases, 2, [done(cases[i]) for i in finished])
    assert [cases.index(case) for case in remaining] == [1, 3, 5, 1, 2, 3, 5]
