"""Verdicts: when they stop, how they fail, and what results say of them."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_records import WORK
from paired_examples import BRIEF, CARTPOLE, INSTALLED, InventedPair
from verdict_records import launch

from benchmarks.studies.simulated_launches import Scenario, simulate, skewed, two_modes
from mjbench.commands.versions import show as verdicts
from mjbench.errors import Failure, MachineError
from mjbench.interval import Interval
from mjbench.paired import pair_launches, target_pair, verdict
from mjbench.paired.metrics import Metric
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import Judgement, LaunchRow, VerdictRecord, WorkDifference
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.verdict import VerdictPlan, judge
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import AS_SHIPPED, Placement, PlacementPair
from mjbench.releases.release_names import ReleaseSpec
from mjbench.results import runs
from mjbench.simulation import models
from mjbench.simulation.starts import KEYFRAME_STARTS, Starts
from mjbench.simulation.state_drift import StateDrift
from mjbench.status import Status


def test_time_runs_out_with_an_interval_and_no_verdict(pool: WorkerPool) -> None:
    ticks = iter(range(0, 10_000, 100))
    plan = VerdictPlan(time_limit_s=350.0, as_shipped=True)
    record = verdict.decide_pair(pool, CARTPOLE, CARTPOLE, plan, clock=lambda: float(next(ticks)))
    assert record.ratio is not None
    assert record.verdict == Verdict.INCONCLUSIVE
    assert "--budget" in record.detail
    assert record.launches == len(record.samples) == 2
    assert record.pairs == 2 * sum(len(sample.orders) for sample in record.samples)
    assert record.diverged is not None
    assert runs.to_json(record)["work"]["old"] == runs.to_json(record)["work"]["new"]


def test_a_model_too_heavy_for_its_limit_is_inconclusive_before_it_is_launched(
    pool: WorkerPool,
) -> None:
    plan = VerdictPlan(as_shipped=True, time_limit_s=2.0, sizes=Sizes(nbatch=1_000_000, nstep=1000))
    row = verdict.decide_pair(pool, CARTPOLE, CARTPOLE, plan, clock=lambda: 0.0)
    assert (row.status, row.samples) == (Status.OK, [])
    assert (row.verdict, row.ratio) == (Verdict.INCONCLUSIVE, None)
    assert "a verdict needs at least 8 launches, " in row.detail
    sentence = verdicts.describe_verdict(row)
    assert ": inconclusive: a launch takes about" in sentence


def test_a_launch_that_proves_too_heavy_is_not_finished(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(target_pair, "launch_s", lambda all_blocks_s, *nsection: 0.01)
    monkeypatch.setattr(pair_launches, "launch_s", lambda all_blocks_s, *nsection: 100.0)
    plan = VerdictPlan(time_limit_s=60.0, as_shipped=True)
    result = verdict.decide_pair(pool, CARTPOLE, CARTPOLE, plan, clock=lambda: 0.0)
    assert result.verdict == Verdict.INCONCLUSIVE
    assert result.detail.startswith("a launch takes about 100 s")
    assert result.work is not None


def test_a_target_in_which_every_simulation_diverges_is_bad_input(
    pool: WorkerPool, stiff: Target
) -> None:
    candidate = replace(stiff, model_options={"timestep": "0.0025"})
    plan = replace(BRIEF, sizes=Sizes(4, 50, starts=KEYFRAME_STARTS))
    result = verdict.decide_pair(pool, stiff, candidate, plan)
    assert result.status == Status.INPUT
    assert "every simulation diverges (BADQACC in 4)" in result.detail


def test_a_model_that_does_not_load_is_bad_input(pool: WorkerPool, tmp_path: Path) -> None:
    file = tmp_path / "broken.xml"
    file.write_text("<mujoco>")
    target = Target(INSTALLED, models.resolve(str(file)))
    result = verdict.decide_pair(pool, target, target, BRIEF)
    assert result.status == Status.INPUT
    assert result.detail.startswith("baseline (MuJoCo")
    assert "cannot load it" in result.detail


def invented_decision(
    monkeypatch: pytest.MonkeyPatch,
    place: Callable[[], PlacementControl],
    use_workload: Callable[[Path], None] = lambda file: None,
) -> VerdictRecord:
    """Decide on launches of a second each that are all alike."""
    clock = [0.0]

    def invent() -> LaunchRow:
        clock[0] += 1.0
        return LaunchRow(0, None, ["ABBA"], [[1, 1, 1, 1]], AS_SHIPPED, [1])

    def pair(pool: Any, targets: Any, sizes: Any, limit: TimeLimit, *_: object) -> InventedPair:
        return InventedPair(limit, invent, place)

    monkeypatch.setattr(verdict, "pair_of", pair)
    pool: Any = None
    plan = VerdictPlan()
    return verdict.decide_pair(
        pool, CARTPOLE, CARTPOLE, plan, clock=lambda: clock[0], use_workload=use_workload
    )


def test_launches_end_once_they_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    files: list[Path] = []
    result = invented_decision(monkeypatch, lambda: PlacementControl(False), files.append)
    assert (result.status, result.detail, result.verdict) == (Status.OK, "", Verdict.SAME)
    assert (result.launches, result.seconds) == (8, 8.0)
    assert files == [Path("workload")]


def test_a_comparison_that_cannot_begin_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> PlacementControl:
        raise MachineError("it fell over")

    result = invented_decision(monkeypatch, fail)
    assert (result.status, result.detail) == (Status.FAILED, "it fell over")
    assert (result.samples, result.placement, result.work) == ([], None, None)


# The decision, on launches whose truth is known.

ATTACKS = (
    Scenario("normal, small", deviation=0.003),
    Scenario("normal, large", deviation=0.015),
    Scenario("two modes", deviation=0.008, noise=two_modes),
    Scenario("skewed", noise=skewed),
    Scenario("disturbed", disturbed=0.1),
    Scenario("out of time", deviation=0.015, most=16),
    Scenario("placed, two modes", deviation=0.008, noise=two_modes, placed=True),
    Scenario("placed, disturbed", disturbed=0.1, placed=True, page_deviation=0.007),
    Scenario("placed, within a page", placed=True, page_deviation=0.007),
)
EASY = (Scenario("as shipped"), Scenario("placed", placed=True))


def name(scenario: Scenario) -> str:
    return scenario.name


@pytest.mark.parametrize("scenario", ATTACKS, ids=name)
def test_identical_targets_are_called_different_at_most_once_in_a_hundred(
    scenario: Scenario,
) -> None:
    outcomes = simulate(scenario, 0.0, 500)
    assert outcomes.share(Verdict.SLOWER, Verdict.FASTER) <= 0.01


@pytest.mark.parametrize("scenario", EASY, ids=name)
def test_a_slowdown_of_1_percent_is_found_and_never_called_faster(scenario: Scenario) -> None:
    outcomes = simulate(scenario, 0.01, 400)
    assert outcomes.share(Verdict.SLOWER) >= 0.95
    assert outcomes.share(Verdict.FASTER) == 0
    assert outcomes.launches.mean() < 25


@pytest.mark.parametrize("scenario", EASY, ids=name)
@pytest.mark.parametrize("truth", [0.0, 0.005, 0.02, -0.02])
def test_intervals_contain_the_truth_although_computed_after_every_launch(
    truth: float, scenario: Scenario
) -> None:
    assert simulate(scenario, truth, 400).covered.mean() >= 0.985  # 99 % with 400 trials


def test_a_slowdown_well_below_the_smallest_effect_is_mostly_called_the_same() -> None:
    outcomes = simulate(Scenario("small", deviation=0.006), 0.003, 400)
    assert outcomes.share(Verdict.SAME) >= 0.9
    assert outcomes.share(Verdict.FASTER) == 0


def test_few_launches_give_no_verdict_however_clear() -> None:
    assert not judge([0.5, 0.5001], VerdictPlan()).enough
    assert judge([0.5, 0.5001] * 5, VerdictPlan()).verdict == Verdict.SLOWER


def test_launches_that_are_all_alike_are_judged() -> None:
    judgement = judge([0.0] * 8, VerdictPlan())
    assert (judgement.verdict, judgement.ratio) == (Verdict.SAME, Interval(1.0, 1.0, 1.0))


def test_placements_are_averaged_out() -> None:
    """A residue that is 5 % slower in the candidate is a slowdown of 1.25 %."""
    residues = [0, 16, 32, 48] * 6
    jitter = np.random.default_rng(0).normal(scale=0.001, size=24)
    log_ratios = [0.05 * (r == 32) + j for r, j in zip(residues, jitter, strict=True)]
    judgement = judge(log_ratios, VerdictPlan(), residues)
    assert judgement.verdict == Verdict.SLOWER
    assert judgement.ratio.estimate == pytest.approx(1.0125, abs=0.0005)
    assert judgement.ratio.is_above(1.01)
    assert judge(log_ratios, VerdictPlan()).verdict == Verdict.INCONCLUSIVE


def test_a_change_in_a_family_needs_an_e_value_that_suffices_for_the_family() -> None:
    log_ratios = list(np.random.default_rng(2).normal(0.02, 0.008, 12))
    alone, one_of_many = (judge(log_ratios, VerdictPlan(family=family)) for family in (1, 1000))
    assert alone.enough
    assert alone.verdict == one_of_many.verdict == Verdict.SLOWER
    assert 100 <= alone.e_slower == one_of_many.e_slower < 100_000
    assert alone.e_faster < 1
    assert not one_of_many.enough
    assert judge([0.0] * 8, VerdictPlan(family=1000)).enough  # `same` waits for no family


def test_a_family_is_rarely_called_slower_and_hardly_takes_more_launches() -> None:
    alone, family = (simulate(EASY[1], 0.01, 400, family=n) for n in (1, 10))
    assert np.mean(family.e_slower >= 1000) >= 0.95
    assert family.launches.mean() <= 1.1 * alone.launches.mean()


# Why two builds differ.

OTHER_BUILD = replace(CARTPOLE, release=ReleaseSpec("3.5.0", "3.5.0"))
SAME_WORK = WorkDifference(
    WORK, WORK, StateDrift(0.0), (0, 0), ({}, {}), nbatch=4, nstep=10, starts=Starts(0.0, 0.0)
)
OTHER_WORK = replace(SAME_WORK, candidate=replace(WORK, contacts=2.0))
MOVED = PlacementControl(True)


def judgement(outcome: Verdict, ratio: float = 1.02, half_width: float = 0.003) -> Judgement:
    return Judgement(outcome, Interval(ratio, ratio - half_width, ratio + half_width), 10, True)


def builds(
    judgement: Judgement | None = None,
    as_shipped: Judgement | None = None,
    work: WorkDifference = SAME_WORK,
    placement: PlacementControl | None = MOVED,
    candidate: Target = CARTPOLE,
) -> VerdictRecord:
    """Return how a comparison of two builds ended; same work, averaged, unless said otherwise."""
    targets = OTHER_BUILD, candidate
    sides = targets[0].row(), targets[1].row()
    record = VerdictRecord.of(sides, Metric.TIME, Failure(Status.OK, ""), judgement, work)
    return verdict.with_placement(record, targets, placement, as_shipped)


SLOWER, SAME = judgement(Verdict.SLOWER), judgement(Verdict.SAME, 1.001)
UNSURE = judgement(Verdict.INCONCLUSIVE, 1.001, 0.03)


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"judgement": SLOWER}, Cause.CODE),
        ({"judgement": judgement(Verdict.FASTER, 0.98), "as_shipped": SLOWER}, Cause.CODE),
        ({"judgement": SLOWER, "placement": PlacementControl(False)}, Cause.UNDECIDED),
        ({"judgement": SLOWER, "placement": PlacementControl(False, "no")}, Cause.UNDECIDED),
        ({"judgement": SLOWER, "work": OTHER_WORK}, Cause.WORK),
        (
            {"judgement": SLOWER, "work": OTHER_WORK, "placement": PlacementControl(False)},
            Cause.WORK,
        ),
        ({"judgement": SAME, "as_shipped": SLOWER}, Cause.PLACEMENT),
        ({"judgement": SAME, "as_shipped": SAME}, None),
        ({"judgement": SAME, "as_shipped": UNSURE}, None),
        ({"judgement": SAME}, None),
        ({"judgement": SAME, "work": OTHER_WORK}, None),
        ({"judgement": UNSURE, "as_shipped": SLOWER}, Cause.UNDECIDED),
        ({"judgement": UNSURE, "work": OTHER_WORK}, Cause.UNDECIDED),
        ({}, None),
        ({"judgement": SLOWER, "placement": None}, None),
        ({"judgement": SLOWER, "candidate": replace(CARTPOLE, path="rollout")}, None),
        ({"judgement": SLOWER, "candidate": replace(CARTPOLE, has_timer=False)}, None),
    ],
)
def test_a_difference_of_two_builds_has_the_cause_that_its_launches_show(
    fields: dict[str, Any], cause: Cause | None
) -> None:
    assert builds(**fields).cause == cause


def test_the_placement_adds_what_is_there_only_as_shipped() -> None:
    as_shipped = judgement(Verdict.SLOWER, 1.05, 0.002)
    effect = builds(judgement=SAME, as_shipped=as_shipped).placement
    assert effect.averaged
    assert effect.as_shipped == as_shipped.ratio
    assert effect.effect.estimate == pytest.approx(1.05 / 1.001)
    assert effect.effect.low == pytest.approx(1.048 / 1.004)
    assert effect.effect.high == pytest.approx(1.052 / 0.998)


def test_few_launches_as_shipped_give_an_effect_without_an_interval() -> None:
    few = Judgement(Verdict.INCONCLUSIVE, Interval(1.05, None, None), 2, False)
    effect = builds(judgement=SAME, as_shipped=few).placement
    assert (effect.effect.low, effect.effect.high) == (None, None)


def test_builds_that_cannot_be_moved_are_compared_as_shipped_and_the_row_says_why() -> None:
    control = PlacementControl(False, "MuJoCo 3.5.0: no reason")
    row = builds(judgement=SLOWER, placement=control)
    assert (row.placement.averaged, row.placement.problem) == (False, "MuJoCo 3.5.0: no reason")
    sentence = verdicts.describe_verdict(row)
    assert "because of its code or of where that lies in memory, same work" in sentence
    assert sentence.endswith("; compared as shipped: MuJoCo 3.5.0: no reason")


def test_launches_as_shipped_have_a_judgement_of_their_own() -> None:
    moved = PlacementPair(Placement(16, 16), Placement(0, 0))
    launches = [launch(0.0, moved)] * 8 + [launch(0.05, AS_SHIPPED)] * 3
    plan = VerdictPlan()
    averaged, shipped = (
        judged(launches, plan, 0.0)
        for judged in (verdict.judge_launches, verdict._judge_as_shipped)
    )
    assert (averaged.verdict, averaged.launches) == (Verdict.SAME, 8)
    # the others help to estimate how far launches spread
    assert (shipped.verdict, shipped.launches) == (Verdict.SLOWER, 11)
    assert shipped.ratio.estimate == pytest.approx(math.exp(0.05))


def test_steps_alike_of_twice_the_timestep_are_twice_as_fast() -> None:
    launches = [launch(0.001 * k, AS_SHIPPED) for k in range(-4, 5)]
    judged = verdict.judge_launches(launches, VerdictPlan(), log_scale=-math.log(2))
    assert judged.verdict == Verdict.FASTER
    assert judged.ratio.estimate == pytest.approx(0.5)
