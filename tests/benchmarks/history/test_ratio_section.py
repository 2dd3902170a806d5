"""The table of what was timed."""

from dataclasses import replace

from speed_histories import record

from benchmarks.history import ratio_section
from benchmarks.history.release_ratios import RatioRecord
from mjbench.results import terminal
from mjbench.status import Status


def lines_with(word: str, records: list[RatioRecord]) -> list[str]:
    """Return the printed lines that hold a word."""
    text = terminal.text_of([ratio_section.section(records)])
    return [line for line in text.splitlines() if word in line]


def failed(release: str, model: str, detail: str) -> RatioRecord:
    """Return a record of a release in which nothing was timed."""
    whole = record(release, 1.0, model, Status.UNAVAILABLE)
    return replace(whole, launches=[], detail=detail)


def test_a_release_that_fails_for_one_reason_has_one_line() -> None:
    records = [failed("9.9.9", model, "no such release") for model in ("pile", "cloth")]
    (line,) = lines_with("9.9.9", [*records, record("1.1", 1.0)])
    assert line.split() == ["all", "9.9.9", "0", "no", "such", "release"]


def test_failures_for_several_reasons_have_a_line_each() -> None:
    records = [failed("2.0", model, f"has no {model}") for model in ("pile", "cloth")]
    assert [line.split()[0] for line in lines_with("has no", records)] == ["pile", "cloth"]


def test_what_was_measured_has_a_line_beside_what_failed() -> None:
    records = [failed("2.0", "pile", "crashed"), record("2.0", 1.1, "cloth")]
    assert [line.split()[0] for line in lines_with("2.0", records)] == ["pile", "cloth"]
