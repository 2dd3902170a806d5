"""What is said of the spread over placements."""

from dataclasses import replace

import pytest

from mjbench.measuring.ratio import Ratio
from mjbench.pages import terminal
from mjbench.paired.placement_spread import ResidueRow, Spread, SpreadRecord
from mjbench.report import placement
from mjbench.status import Status

RESIDUES = [
    ResidueRow(0, Ratio(1.0, 0.99, 1.01), 14),
    ResidueRow(16, Ratio(1.124, 1.11, 1.14), 14),
    ResidueRow(32, Ratio(1.05, None, None), 2),
]
ROW = SpreadRecord(
    model="cloth",
    release="3.3.1",
    build="b",
    status=Status.OK,
    spread=Spread(0.124, 0.099, 0.152),
    residues=RESIDUES,
    launches=30,
    seconds=12.34,
)


@pytest.mark.parametrize(
    ("spread", "detail", "sentence"),
    [
        (
            Spread(0.124, 0.099, 0.152),
            "",
            "where the code lies changes the time of a step by 12 % (interval 9.9 to 15 %), so a"
            " benchmark of one build says no more than that",
        ),
        (
            Spread(0.004, 0.0, 0.013),
            "time ran out after 30 of 56 launches",
            "no dependence on where the code lies was seen; it is at most 1.3 % (time ran out after"
            " 30 of 56 launches)",
        ),
        (
            Spread(0.03, None, None),
            "",
            "the placements differ by 3 %, by chance or not: too few launches for an interval",
        ),
        (None, "its code cannot be moved: it is a program", "its code cannot be moved: it is a"),
        (None, "", "too few launches"),
    ],
)
def test_a_spread_is_a_sentence(spread: Spread | None, detail: str, sentence: str) -> None:
    described = placement.describe_spread(replace(ROW, spread=spread, detail=detail))
    assert described.startswith(f"cloth, MuJoCo 3.3.1: {sentence}")


def test_sentences_come_first_and_the_table_has_every_residue() -> None:
    failed = replace(ROW, model="pile", spread=None, residues=(), detail="killed")
    text = terminal.text_of([placement.section([ROW, failed])])
    first, second, headings, cells, *_ = text.splitlines()
    assert first.startswith("cloth, MuJoCo 3.3.1: where")
    assert second == "pile, MuJoCo 3.3.1: killed"
    assert "moved by 16" in headings
    for text in ("12 %", "9.9–15 %", "+0.0 % (-1.0 to +1.0 %)", "+12.4 % (+11.0", "+5.0 "):
        assert text in cells
    assert cells.split()[-2:] == ["30", "12.3"]


def test_without_any_launch_there_is_no_table() -> None:
    failed = replace(ROW, spread=None, residues=(), detail="killed")
    assert terminal.text_of([placement.section([failed])]) == "cloth, MuJoCo 3.3.1: killed"
