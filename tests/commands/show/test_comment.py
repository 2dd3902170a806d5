"""A comment on a pull request: its headline follows from its rows."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from set_files import run_of
from verdict_records import FAILED, OPEN, SAME, SLOWER, of_model

from mjbench.commands.show import comment
from mjbench.errors import InputError
from mjbench.interval import Interval
from mjbench.paired.outcomes import ResultsOutcome
from mjbench.paired.records import ControlRow, Pair, VerdictRecord
from mjbench.status import Status

CONTROL = ControlRow(Interval(1.002, 0.996, 1.008), 8, covers=True)


def of_function(verdict: VerdictRecord, name: str, **fields: Any) -> VerdictRecord:
    """Return the verdict on a function of two revisions."""
    sides = tuple(
        replace(side, release="4.0.0", revision=revision, commit=commit * 40, model=name, path="")
        for side, revision, commit in zip(verdict.sides, ("main", "HEAD"), "ab", strict=True)
    )
    return replace(
        verdict,
        model=name,
        path="",
        old="main",
        new="HEAD",
        sides=sides,
        results=ResultsOutcome.SAME,
        control=CONTROL,
        calls_s=Pair(12.4e-6, 13e-6),
        **fields,
    )


NEW = replace(FAILED, status=Status.NEW, detail="new, so not compared: bench has no reset")


def lines(records: Sequence[VerdictRecord], words: Sequence[str] = ()) -> list[str]:
    return comment.text(run_of("ab", *records, command_line=tuple(words))).splitlines()


@pytest.mark.parametrize(
    ("records", "headline"),
    [
        ([SAME, of_model(SAME, "n")], "✅ 2 same: no action needed"),
        ([SLOWER, of_model(SAME, "n")], "❌ 1 slower · ✅ 1 same: action needed"),
        ([OPEN, of_model(SAME, "n")], "❔ 1 undecided · ✅ 1 same: look at what is undecided"),
        ([FAILED], "❌ 1 not measured: action needed"),
        ([NEW], "⚠️ nothing was compared: 🆕 1 new"),
        ([NEW, of_model(SAME, "n")], "🆕 1 new · ✅ 1 same: no action needed"),
        ([replace(FAILED, status=Status.DISAGREES)], "❌ 1 with other results: action needed"),
        ([], "⚠️ nothing was compared"),
    ],
)
def test_the_headline_counts_the_rows(records: list[VerdictRecord], headline: str) -> None:
    text = lines(records)
    assert text[:2] == ["<!-- mjbench:ab -->", f"### mjbench: {headline}"]


def test_changed_rows_are_shown_and_all_are_folded() -> None:
    records = [of_function(SLOWER, "bench.py::step"), of_function(SAME, "bench.py::reset")]
    text = lines(records)
    folded = text.index("<details><summary>All 2 comparisons</summary>")
    shown = "\n".join(text[:folded])
    assert "| ❌ | bench.py::step | +3.00 % (+2.00 to +4.00 %) | 12.4 µs | slower |" in shown
    assert "reset" not in shown
    assert "bench.py::reset, main → HEAD: same within 0.4 %" in "\n".join(text[folded:])


def test_the_sides_and_the_control_stand_above_the_rows() -> None:
    text = lines([of_function(SLOWER, "bench.py::step")])
    assert text[2].startswith("main `aaaaaaaaaa` → HEAD `bbbbbbbbbb` · one job, blocks in turns")
    assert text[3].startswith("control, the baseline against itself: +0.20 %")


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ("ab rev=main rev=HEAD b.py::f", "ab rev=aaaaaaaaaa rev=bbbbbbbbbb b.py::f"),
        ("ab -q rev=main rev=HEAD b.py::f", "ab -q rev=aaaaaaaaaa rev=bbbbbbbbbb b.py::f"),
        (f"ab rev={'a' * 40} HEAD b.py::f", "ab rev=aaaaaaaaaa rev=bbbbbbbbbb b.py::f"),
    ],
)
def test_the_command_that_reproduces_it_names_commits(words: str, command: str) -> None:
    text = lines([of_function(SLOWER, "b.py::f")], words.split())
    assert f"Reproduce: `mjbench {command}`" in text


def test_releases_are_named_as_such() -> None:
    assert "MuJoCo 1.0.0 → MuJoCo 2.0.0 · one job" in "\n".join(lines([SLOWER]))


def test_names_are_no_markup() -> None:
    record = of_function(SLOWER, "bench.py::<b>*step*")
    assert "bench.py::\\<b\\>\\*step\\*" in "\n".join(lines([record]))


def test_a_comment_is_no_longer_than_github_allows() -> None:
    records = [of_model(SAME, f"{'m' * 200}{n}") for n in range(400)]
    text = lines(records)
    assert len("\n".join(text)) <= 60_100
    assert text[-1] == "The rest is left out."


def test_a_run_of_another_command_is_refused() -> None:
    record: Any = object()
    with pytest.raises(InputError, match="a run of `profile` has no verdicts"):
        comment.text(run_of("profile", record))
