"""What parts of a judgement come to together."""

from dataclasses import replace

import pytest
from example_records import PAIR

from mjbench.simulation.accelerated_judgement import (
    EngineAnswer,
    EngineJudgement,
    JudgedPart,
    Measure,
    PartName,
    Precision,
)

SMOOTH = JudgedPart.of(PartName.SMOOTH, Measure("a step", 1e-15, 1e-12))
CLOSE = JudgedPart(PartName.CONTACTS, EngineAnswer.CLOSE, reason="box–box")
FAILED = JudgedPart.of(PartName.CONSTRAINTS, Measure("forces", 0.01, 1e-6))
UNKNOWN = JudgedPart(PartName.CONTACTS, EngineAnswer.NOT_JUDGED, reason="none reported")


def judged(*parts: JudgedPart) -> EngineJudgement:
    return EngineJudgement.of(Precision.FLOAT64, parts)


@pytest.mark.parametrize(
    ("parts", "answer", "agrees"),
    [
        ((SMOOTH,), EngineAnswer.YES, True),
        ((SMOOTH, CLOSE), EngineAnswer.CLOSE, True),
        ((SMOOTH, CLOSE, UNKNOWN), EngineAnswer.NOT_JUDGED, None),
        ((SMOOTH, CLOSE, UNKNOWN, FAILED), EngineAnswer.NO, False),
    ],
)
def test_the_worst_part_decides(
    parts: tuple[JudgedPart, ...], answer: EngineAnswer, agrees: bool | None
) -> None:
    judgement = judged(*parts)
    assert (judgement.answer, judgement.agrees) == (answer, agrees)


def test_the_reason_names_the_parts_that_decide_alone() -> None:
    assert judged(SMOOTH).reason == ""
    assert judged(SMOOTH, CLOSE).reason == "contacts: box–box"
    assert judged(CLOSE, FAILED).reason == "constraint problem: forces 0.01 (limit 1e-06)"


@pytest.mark.parametrize(
    ("value", "limit", "is_within"), [(1.0, 1.0, True), (1.1, 1.0, False), (None, 1.0, False)]
)
def test_what_is_not_finite_is_beyond_every_limit(
    value: float | None, limit: float, is_within: bool
) -> None:
    assert Measure("m", value, limit).is_within == is_within
    assert Measure("m", value).is_within


def test_timed_blocks_that_end_elsewhere_make_the_run_fail() -> None:
    failed = judged(SMOOTH, JudgedPart(PartName.RUN, EngineAnswer.YES)).with_failed_run("elsewhere")
    assert (failed.answer, failed.reason) == (EngineAnswer.NO, "run: elsewhere")
    assert [part.name for part in failed.parts] == [PartName.SMOOTH, PartName.RUN]


def test_a_pair_says_how_its_contacts_differ() -> None:
    differing = {"states": 60, "other_counts": 12, "count_in_c": 8.0}
    effects = {"effect": 0.03, "largest_effect": 0.2}
    pair = replace(PAIR, types=("box", "box"), **differing, **effects)
    assert str(pair) == (
        "box–box: 4 contacts instead of 8 (other numbers in 12 of 60 states),"
        " which changes accelerations by 3 %, in one state by 20 %"
    )
