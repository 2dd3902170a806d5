"""What comparisons show together."""

from dataclasses import replace

from mjbench.commands.versions import family
from mjbench.interval import Interval
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import PlacementEffect, VerdictRow
from mjbench.status import Status

SAME = VerdictRow(
    model="m",
    path="python_loop",
    old="1",
    new="2",
    sides=(),
    status=Status.OK,
    verdict=Verdict.SAME,
    ratio=Interval(1.0, 0.99, 1.01),
    e_slower=0.1,
    e_faster=0.1,
)
SLOWER = replace(SAME, verdict=Verdict.SLOWER, e_slower=150.0)


def test_one_change_among_many_needs_more_evidence_than_one_alone() -> None:
    assert family.adjust_for_family([SLOWER], 0.99).slower == [SLOWER]
    many = family.adjust_for_family([SLOWER, *[SAME] * 9], 0.99)
    assert (many.slower, many.undecided, many.count) == ([], [SLOWER], 10)
    certain = replace(SLOWER, e_slower=1000.0)
    assert family.adjust_for_family([certain, *[SAME] * 9], 0.99).slower == [certain]


def test_several_changes_need_less_evidence_each() -> None:
    rows = [replace(SLOWER, model=name, e_slower=500.0) for name in ("a", "b")]
    assert family.adjust_for_family([*rows, *[SAME] * 8], 0.99).slower == rows


def test_evidence_of_comparisons_that_are_not_named_does_not_count() -> None:
    small = replace(SAME, e_slower=1e6)  # slower, but by less than what matters
    assert family.adjust_for_family([SLOWER, *[small] * 9], 0.99).slower == []
    unable = PlacementEffect(averaged=False, problem="no libmujoco")
    unclear = replace(SLOWER, e_slower=1e6, cause=Cause.UNDECIDED, placement=unable)
    decided = family.adjust_for_family([SLOWER, *[unclear] * 9], 0.99)
    assert (decided.slower, len(decided.undecided)) == ([], 10)


def test_directions_are_decided_apart() -> None:
    faster = replace(SAME, verdict=Verdict.FASTER, e_faster=1e6)
    decided = family.adjust_for_family([replace(SLOWER, e_slower=1e6), faster], 0.99)
    assert (len(decided.slower), decided.faster, decided.undecided) == (1, [faster], [])


def test_counts_are_certain_and_what_was_not_decided_stays_so() -> None:
    counted = replace(SLOWER, metric=Metric.INSTRUCTIONS, e_slower=None, e_faster=None)
    failed = replace(SAME, status=Status.FAILED, verdict=None, ratio=None, e_slower=None)
    open_row = replace(SAME, verdict=Verdict.INCONCLUSIVE)
    decided = family.adjust_for_family([counted, failed, open_row], 0.99)
    assert decided.slower == [counted]
    assert decided.undecided == [failed, open_row]
