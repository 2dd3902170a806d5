"""`--fail-on`: what turns the exit code, and that nothing undecided passes."""

from dataclasses import replace

import pytest
from set_files import run_of

from mjbench.commands.versions.bisect import BisectChange, BisectRecord, VersionRow
from mjbench.commands.versions.fail_on import FailOnOptions as FailOn
from mjbench.commands.versions.fail_on import GateFinding
from mjbench.interval import Interval
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import PlacementEffect, VerdictRow
from mjbench.status import Status

SPEED = (GateFinding.SLOWER,)


def row(
    verdict: Verdict | None, status: Status = Status.OK, changed_work: bool = False
) -> VerdictRow:
    return VerdictRow(
        model="m",
        path="python_loop",
        old="1",
        new="2",
        sides=(),
        status=status,
        verdict=verdict,
        ratio=Interval(1.0, None, None),
        e_slower=1e6 if verdict == Verdict.SLOWER else 0.1,
        e_faster=1e6 if verdict == Verdict.FASTER else 0.1,
        changed_work=changed_work,
    )


@pytest.mark.parametrize(
    ("verdicts", "findings", "code"),
    [
        ([Verdict.SAME, Verdict.FASTER], SPEED, 0),
        ([Verdict.SAME, Verdict.SLOWER], SPEED, 1),
        ([Verdict.SLOWER], (), 0),
        ([Verdict.SLOWER], (GateFinding.FASTER,), 0),
        ([Verdict.SAME, Verdict.INCONCLUSIVE], SPEED, 3),
        ([None], SPEED, 3),
        ([Verdict.SLOWER, Verdict.INCONCLUSIVE], SPEED, 1),
        ([Verdict.INCONCLUSIVE], (GateFinding.FASTER,), 3),
        ([Verdict.INCONCLUSIVE], (GateFinding.INCONCLUSIVE,), 1),
        ([Verdict.INCONCLUSIVE], (GateFinding.CHANGED_WORK,), 0),
        ([Verdict.INCONCLUSIVE], (), 0),
    ],
)
def test_it_passes_only_when_what_it_asks_is_decided(
    verdicts: list[Verdict | None], findings: tuple[GateFinding, ...], code: int
) -> None:
    assert FailOn(findings).exit_code([row(verdict) for verdict in verdicts], 0.99) == code


@pytest.mark.parametrize(
    ("ends", "changes", "finding", "code"),
    [
        (Verdict.SLOWER, [Verdict.SLOWER, Verdict.FASTER], GateFinding.FASTER, 1),
        (Verdict.SLOWER, [Verdict.SLOWER], GateFinding.FASTER, 0),
        (Verdict.SLOWER, [], GateFinding.SLOWER, 1),
        (Verdict.INCONCLUSIVE, [], GateFinding.SLOWER, 3),
    ],
)
def test_a_search_fails_by_the_changes_that_it_finds_or_by_its_ends(
    ends: Verdict, changes: list[Verdict], finding: GateFinding, code: int
) -> None:
    record = BisectRecord(
        target="m",
        old="1",
        new="3",
        versions=2,
        status=Status.OK,
        ends=row(ends),
        changes=[BisectChange(VersionRow(1, "2"), row(verdict)) for verdict in changes],
    )
    assert FailOn((finding,)).exit_code_of_run(run_of("bisect", record), 0.99) == code


def test_an_inconclusive_verdict_passes_where_the_user_allows_it() -> None:
    open_rows = [row(Verdict.INCONCLUSIVE), row(Verdict.SAME)]
    assert FailOn(SPEED, allow_inconclusive=True).exit_code(open_rows, 0.99) == 0
    assert FailOn(SPEED, allow_inconclusive=True).exit_code([row(Verdict.SLOWER)], 0.99) == 1


def test_a_difference_that_may_be_placement_is_undecided_unless_asked_for_as_shipped() -> None:
    could_not = PlacementEffect(averaged=False, problem="MuJoCo 2: its package holds no libmujoco")
    slower = replace(row(Verdict.SLOWER), cause=Cause.UNDECIDED, placement=could_not)
    assert FailOn(SPEED).exit_code([slower], 0.99) == 3
    assert FailOn(SPEED, allow_inconclusive=True).exit_code([slower], 0.99) == 3
    assert FailOn(SPEED).exit_code([replace(slower, placement=PlacementEffect(False))], 0.99) == 1
    assert FailOn(SPEED).exit_code([replace(slower, cause=Cause.WORK)], 0.99) == 1
    assert FailOn(SPEED).exit_code([replace(slower, verdict=Verdict.SAME, cause=None)], 0.99) == 0


def test_a_change_among_many_comparisons_needs_more_evidence() -> None:
    slower = replace(row(Verdict.SLOWER), e_slower=150.0, e_faster=0.1)
    others = [replace(row(Verdict.SAME), e_slower=0.1, e_faster=0.1)] * 9
    assert FailOn(SPEED).exit_code([slower], 0.99) == 1
    assert FailOn(SPEED).exit_code([slower, *others], 0.99) == 3
    assert FailOn(SPEED).exit_code([replace(slower, e_slower=1000.0), *others], 0.99) == 1


def test_no_comparison_with_another_verdict_makes_a_change_certain() -> None:
    """Small slowdowns that are called the same do not add to the evidence of another one."""
    slower = replace(row(Verdict.SLOWER), e_slower=150.0)
    same = replace(row(Verdict.SAME), e_slower=1e6)
    assert FailOn(SPEED).exit_code([slower, *[same] * 9], 0.99) == 3


def test_work_that_was_not_compared_does_not_pass() -> None:
    unknown = replace(row(Verdict.INCONCLUSIVE), changed_work=None)
    assert FailOn((GateFinding.CHANGED_WORK,)).exit_code([unknown], 0.99) == 3
    assert (
        FailOn((GateFinding.CHANGED_WORK,), allow_inconclusive=True).exit_code([unknown], 0.99) == 3
    )


def test_changed_work_is_a_finding_of_its_own() -> None:
    rows = [row(Verdict.INCONCLUSIVE, changed_work=True)]
    assert FailOn((GateFinding.CHANGED_WORK,)).exit_code(rows, 0.99) == 1
    assert FailOn(()).exit_code(rows, 0.99) == 0
    assert FailOn(SPEED).exit_code([row(Verdict.SAME, changed_work=True)], 0.99) == 0


@pytest.mark.parametrize(
    ("status", "code"),
    [(Status.FAILED, 3), (Status.CRASHED, 3), (Status.INPUT, 2), (Status.INTERRUPTED, 130)],
)
def test_a_failure_outweighs_a_finding(status: Status, code: int) -> None:
    assert FailOn(SPEED).exit_code([row(Verdict.SLOWER), row(None, status)], 0.99) == code
