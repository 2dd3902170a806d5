"""What comparisons show on several machines."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from verdict_records import FAILED, FASTER, OPEN, SAME, SIDES, SLOWER

from mjbench.measuring.ratio import Ratio
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import PlacementEffect, VerdictRow
from mjbench.paired.verdict import judge
from mjbench.report import verdicts_across
from mjbench.report.verdicts_across import (
    AcrossMachines,
    Conditions,
    MachineComparison,
    MachineRow,
    MachinesOutcome,
)
from mjbench.store.runs import InputFile


def decided(**rows: VerdictRow) -> MachineComparison:
    """Return the one comparison that machines measured, by their names."""
    return only(verdicts_across.decide([MachineRow(name, row) for name, row in rows.items()]))


def only(across: AcrossMachines) -> MachineComparison:
    (comparison,) = across.comparisons
    return comparison


def outcomes(comparison: MachineComparison) -> dict[str, str]:
    return {verdict.machine: verdict.outcome.value for verdict in comparison.machines}


# one comparison


def test_each_machine_has_its_own_verdict() -> None:
    comparison = decided(a=SLOWER, b=SLOWER, c=SLOWER, d=SAME)
    assert outcomes(comparison) == {"a": "slower", "b": "slower", "c": "slower", "d": "same"}
    assert [verdict.ratio for verdict in comparison.machines] == [SLOWER.ratio] * 3 + [SAME.ratio]
    assert (comparison.old, comparison.new, comparison.nbatch) == ("1.0.0", "2.0.0", 4)


def test_what_is_not_certain_is_undecided_and_not_the_same() -> None:
    weak = replace(SLOWER, e_slower=150.0)
    comparison = decided(a=weak, b=OPEN, c=FAILED, d=SAME)
    assert outcomes(comparison) == {
        "a": "undecided",
        "b": "undecided",
        "c": "undecided",
        "d": "same",
    }
    assert [verdict.detail for verdict in comparison.machines] == [
        "slower if judged alone",
        "inconclusive",
        "signal 11",
        "",
    ]


def test_evidence_that_suffices_alone_does_not_beside_other_machines() -> None:
    weak = replace(SLOWER, e_slower=150.0)
    assert outcomes(decided(a=weak)) == {"a": "slower"}
    assert outcomes(decided(a=weak, b=SAME))["a"] == "undecided"
    assert outcomes(decided(a=weak, b=weak)) == {"a": "slower", "b": "slower"}


def test_a_change_that_may_be_placement_is_undecided() -> None:
    unable = PlacementEffect(averaged=False, problem="no libmujoco")
    unclear = replace(SLOWER, cause=Cause.UNDECIDED, placement=unable)
    (verdict,) = decided(a=unclear).machines
    assert verdict.outcome == MachinesOutcome.UNDECIDED
    assert "where its code lies" in verdict.detail


def test_older_files_decide_no_change() -> None:
    (verdict,) = decided(a=replace(SLOWER, e_slower=None, e_faster=None)).machines
    assert (verdict.outcome, verdict.verdict) == (MachinesOutcome.UNDECIDED, Verdict.SLOWER)
    assert "older file" in verdict.detail


def test_machines_differ_where_intervals_do_not_overlap() -> None:
    assert decided(a=SLOWER, b=SAME).differs
    assert not decided(a=SLOWER, b=replace(SLOWER, ratio=Ratio(1.05, 1.035, 1.06))).differs
    assert not decided(a=SLOWER, b=replace(OPEN, ratio=Ratio(1.0, None, None))).differs
    assert not decided(a=FAILED).differs


def test_counts_are_certain() -> None:
    counted = replace(SLOWER, metric=Metric.INSTRUCTIONS, e_slower=None, e_faster=None)
    assert outcomes(decided(a=counted, b=counted)) == {"a": "slower", "b": "slower"}


# a comparison that a machine measured several times


def repeated(*rows: VerdictRow) -> MachineComparison:
    return only(verdicts_across.decide([MachineRow("a", row) for row in rows]))


def test_a_machine_counts_once() -> None:
    (verdict,) = repeated(SLOWER, SLOWER, SLOWER).machines
    assert (verdict.outcome, verdict.count) == (MachinesOutcome.SLOWER, 3)


@pytest.mark.parametrize("other", [SAME, FASTER, OPEN])
def test_measurements_that_do_not_agree_decide_nothing(other: VerdictRow) -> None:
    (verdict,) = repeated(SLOWER, other).machines
    assert (verdict.outcome, verdict.verdict) == (MachinesOutcome.UNDECIDED, None)
    assert verdict.detail == f"measured 2 times: slower, {other.verdict}"


def test_a_measurement_that_failed_before_another_one_says_nothing() -> None:
    (verdict,) = repeated(FAILED, SLOWER).machines
    assert (verdict.outcome, verdict.count) == (MachinesOutcome.SLOWER, 2)


def test_all_measurements_must_be_certain_and_none_is_averaged() -> None:
    wide = replace(SLOWER, e_slower=50.0, ratio=Ratio(1.05, 1.0, 1.1))
    (verdict,) = repeated(SLOWER, wide).machines
    assert (verdict.outcome, verdict.ratio) == (MachinesOutcome.UNDECIDED, wide.ratio)


# what is one comparison


@pytest.mark.parametrize(
    "change",
    [
        {"model": "other"},
        {"path": "rollout"},
        {"nbatch": 8},
        {"nstep": 51},
        {"metric": Metric.MEMORY},
        {"sides": (SIDES[0], replace(SIDES[1], options={"threads": 2}))},
        {"sides": (SIDES[0], replace(SIDES[1], build="2.0.0+0123abcd-cpython-311-x86_64-numpy2"))},
    ],
)
def test_unlike_things_are_kept_apart(change: dict[str, object]) -> None:
    across = verdicts_across.decide(
        [MachineRow("a", SLOWER), MachineRow("b", replace(SLOWER, **change))]
    )
    assert [len(comparison.machines) for comparison in across.comparisons] == [1, 1]
    assert across.machines == ["a", "b"]


@pytest.mark.parametrize(
    "change",
    [
        {"conditions": Conditions(min_effect=0.02)},
        {"conditions": Conditions(as_shipped=True)},
        {"files": (InputFile("m.xml", "0" * 64),)},
    ],
)
def test_other_conditions_are_kept_apart(change: dict[str, object]) -> None:
    row = MachineRow("a", SLOWER)
    across = verdicts_across.decide([row, replace(row, machine="b", **change)])
    assert len(across.comparisons) == 2


def test_builds_of_a_release_for_several_processors_are_one_release() -> None:
    arm = [replace(s, build=s.build.replace("x86_64", "aarch64")) for s in SIDES]
    assert len(decided(a=SAME, b=replace(SAME, sides=arm)).machines) == 2


def test_what_failed_before_its_size_was_known_belongs_to_the_only_size() -> None:
    assert len(decided(a=SAME, b=FAILED).machines) == 2
    other = replace(SAME, nbatch=8)
    across = verdicts_across.decide(
        [MachineRow(n, r) for n, r in zip("abc", (SAME, other, FAILED), strict=True)]
    )
    assert [len(comparison.machines) for comparison in across.comparisons] == [1, 1, 1]


def test_the_highest_confidence_holds_for_all() -> None:
    rows = [MachineRow("a", SAME, 0.95), MachineRow("b", SAME, 0.999)]
    assert verdicts_across.decide(rows).confidence == 0.999


def test_nothing_was_measured() -> None:
    across = verdicts_across.decide([])
    assert (across.comparisons, across.machines) == ([], [])


# how often a verdict is wrong

CONFIDENCE, DEVIATION = 0.9, 0.0085
MODELS, MACHINES = "abcde", ("m1", "m2", "m3", "m4")


def simulated(random: np.random.Generator, change: float) -> VerdictRow:
    """Return a verdict on launches that are looked at four times, until it is certain."""
    launches = random.normal(np.log1p(change), DEVIATION, 40)
    for count in (8, 12, 20, 40):
        judgement = judge(launches[:count], 0.01, CONFIDENCE, 0.005)
        if judgement.enough:
            break
    return replace(
        SAME,
        verdict=judgement.verdict,
        ratio=judgement.ratio,
        e_slower=judgement.e_slower,
        e_faster=judgement.e_faster,
    )


def simulated_sets(seed: int, count: int, changes: Sequence[float]) -> Iterator[AcrossMachines]:
    """Yield sets of five models on four machines, on each of which a model changes so much."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        yield verdicts_across.decide(
            [
                MachineRow(machine, replace(simulated(random, change), model=model), CONFIDENCE)
                for model in MODELS
                for machine, change in zip(MACHINES, changes, strict=True)
            ]
        )


def test_where_nothing_changed_a_change_is_named_in_no_more_sets_than_stated() -> None:
    named = alone = 0
    sets = list(simulated_sets(1, 60, [0.0] * 4))
    for across in sets:
        changes = [
            v
            for v in across.verdicts
            if v.outcome in (MachinesOutcome.SLOWER, MachinesOutcome.FASTER)
        ]
        named += bool(changes)
        alone += any(v.verdict in (Verdict.SLOWER, Verdict.FASTER) for v in across.verdicts)
    # each direction has its own rate
    assert named <= 2 * (1 - CONFIDENCE) * len(sets)
    assert alone > 2 * named, "each verdict alone would be wrong in more sets"


def test_machines_that_differ_are_named_rightly() -> None:
    changes = dict(zip(MACHINES, (0.03, 0.03, 0.03, 0.0), strict=True))
    false_shares, found = [], []
    for across in simulated_sets(2, 20, list(changes.values())):
        slower = [v for v in across.verdicts if v.outcome == MachinesOutcome.SLOWER]
        false_shares.append(np.mean([changes[v.machine] == 0.0 for v in slower]))
        assert not any(v.outcome == MachinesOutcome.FASTER for v in across.verdicts)
        assert not any(
            v.outcome == MachinesOutcome.SAME and changes[v.machine] for v in across.verdicts
        )
        found += [
            [len(c.of_outcome(MachinesOutcome.SLOWER)), len(c.of_outcome(MachinesOutcome.SAME))]
            == [3, 1]
            for c in across.comparisons
        ]
    assert np.mean(false_shares) <= 1 - CONFIDENCE
    assert np.mean(found) > 0.8
