"""What a search for a slower commit comes to, as people read it."""

from dataclasses import replace

from verdict_records import SAME, SLOWER

from mjbench.commands.versions import bisect_show as bisect
from mjbench.commands.versions.bisect import (
    BisectChange,
    BisectComparison,
    BisectRecord,
    VersionKind,
    VersionRow,
)
from mjbench.paired.outcomes import Verdict
from mjbench.status import Status

SEVEN = VersionRow(7, "7" * 40, "Copy states")
SIX = VersionRow(6, "6" * 40, "Break the build")
RECORD = BisectRecord(
    target="bench.py::step",
    old="v1",
    new="HEAD",
    versions=64,
    status=Status.OK,
    ends=SLOWER.row(),
    changes=[BisectChange(SEVEN, SLOWER.row())],
    seconds=90.0,
)


COMPARISONS = [
    BisectComparison(0, VersionRow(64, "a" * 40, "Release"), SLOWER),
    BisectComparison(0, SIX, None, "cannot build it"),
    BisectComparison(0, SEVEN, SLOWER),
]


def sentences(record: BisectRecord) -> list[str]:
    (section,) = bisect.sections([*COMPARISONS, record])
    return [conclusion.text for conclusion in section.conclusions]


def test_the_commit_stands_with_its_subject_and_its_change() -> None:
    change, ends, effort = sentences(RECORD)
    assert "slower by 3 %" in ends
    assert change.startswith("7777777777 “Copy states”: slower by 3 % (interval")
    assert effort.startswith("3 comparisons among 64 commits in 90.0 s")


def test_commits_that_may_be_it_instead_are_named() -> None:
    record = replace(RECORD, changes=[BisectChange(SEVEN, SLOWER.row(), [SIX])])
    assert sentences(record)[0].endswith("or one of 6666666666, which could not be measured")


def test_ends_that_do_not_differ_leave_nothing_to_search_for() -> None:
    record = replace(RECORD, ends=SAME.row(), changes=[])
    assert sentences(record)[1:] == ["So there is nothing to search for."]


def test_ends_that_stay_inconclusive_ask_for_more_time() -> None:
    ends = replace(SAME, verdict=Verdict.INCONCLUSIVE).row()
    assert sentences(replace(RECORD, ends=ends, changes=[]))[1:] == [
        "It is not certain whether there is anything to search for: repeat with a longer --budget,"
        " or on a quieter machine"
    ]


def test_a_search_that_failed_says_why() -> None:
    assert sentences(replace(RECORD, status=Status.FAILED, detail="it crashed")) == [
        "bench.py::step: it crashed"
    ]


def test_a_search_that_did_not_end_says_what_is_known_and_how_it_goes_on() -> None:
    (section,) = bisect.sections(COMPARISONS)
    assert section.heading == f"Which release changed {SLOWER.row().model}?"
    assert "repeat the command with --resume" in section.conclusions[0].text
    assert "slower by 3 %" in section.conclusions[1].text
    assert len(section.tables[0].rows) == 3


def test_comparisons_are_listed_with_what_they_came_to() -> None:
    (section,) = bisect.sections([*COMPARISONS, RECORD])
    _, failed, last = (row[2:] for row in section.tables[0].rows)
    assert failed == ["6666666666", None, None, "cannot build it"]
    assert last == ["7777777777", 1.03, "slower", "Copy states"]


def test_a_release_stands_with_what_tells_more() -> None:
    verdict = replace(SLOWER, old="3.3.0", new="3.3.1").row()
    release = BisectChange(VersionRow(2, "3.3.1"), verdict)
    record = replace(RECORD, kind=VersionKind.RELEASE, target="cartpole", changes=[release])
    (section,) = bisect.sections([record])
    assert section.heading == "Which release changed cartpole?"
    change, command, *_ = (conclusion.text for conclusion in section.conclusions)
    assert change.startswith("3.3.1: slower by 3 % (interval")
    assert command.endswith("mjbench versions --explain 3.3.0 3.3.1 cartpole")
