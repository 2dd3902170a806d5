"""Two runs of one kind, figure by figure."""

from dataclasses import replace
from pathlib import Path

import pytest
from set_files import labelled, run_of
from verdict_records import SAME, SLOWER, of_model

from mjbench.commands.profile.measure import ProfileRow
from mjbench.commands.show import side_by_side
from mjbench.commands.show.reports import NamedRun
from mjbench.commands.show.side_by_side import FigureDifference, pair_of
from mjbench.errors import InputError
from mjbench.host.disturbance import Disturbance
from mjbench.host.machine import Machine
from mjbench.interval import Interval
from mjbench.paired.records import VerdictRecord
from mjbench.results.runs import Record
from mjbench.status import Status

DESK, LAPTOP = labelled("desk"), labelled("laptop")


def named(*records: Record, began: str = "", machine: Machine = DESK) -> NamedRun:
    run = run_of("versions", *records, machine=machine, began=began)
    return NamedRun(Path(f"{began or 'run'}.jsonl"), run)


def profile(model: str) -> ProfileRow:
    return ProfileRow(model, Status.FAILED, "late")


def with_ratio(estimate: float, low: float, high: float) -> VerdictRecord:
    return replace(SLOWER, ratio=Interval(estimate, low, high))


def differences(old: NamedRun, new: NamedRun) -> dict[str, FigureDifference]:
    rows = side_by_side.differences(old.run, new.run, across=False)
    return {row.figure: row for row in rows if isinstance(row, FigureDifference)}


def test_the_older_run_is_the_baseline() -> None:
    early, late = named(SAME, began="2026-11-01"), named(SLOWER, began="2026-11-02")
    assert pair_of([late, early], across=False) == [early, late]


def test_runs_of_two_machines_are_a_pair_only_across_them() -> None:
    two = [named(SAME), named(SLOWER, machine=LAPTOP)]
    assert pair_of(two, across=False) == []
    assert pair_of(two, across=True) == two


def test_runs_of_two_machines_are_said_to_say_nothing_about_the_code() -> None:
    two = [named(profile("humanoid")), named(profile("humanoid"), machine=LAPTOP)]
    sentence = side_by_side.of_two_machines(two)
    assert sentence.startswith("Measured on two machines (desk / laptop): no verdict")
    assert side_by_side.of_two_machines([two[0], two[0]]) == ""
    verdicts = [named(SAME), named(SLOWER, machine=LAPTOP)]
    assert side_by_side.of_two_machines(verdicts) == "", "each has a verdict of its own"


def test_runs_of_different_models_are_a_pair_only_if_asked() -> None:
    two = [named(SAME), named(of_model(SAME, "other"))]
    assert pair_of(two, across=False) == []
    assert pair_of(two, across=True) == two


def test_two_runs_that_are_no_pair_say_why() -> None:
    verdict, profiled = named(SAME), named(profile("humanoid"))
    profiled = NamedRun(
        profiled.file, replace(profiled.run, header=replace(profiled.run.header, command="profile"))
    )
    text = side_by_side.of_two_subjects([verdict, profiled])
    assert text == "Not compared: one run is of `versions`, the other of `profile`"
    text = side_by_side.of_two_subjects([verdict, named(of_model(SAME, "other"))])
    assert text == "Not compared: one run is of m, the other of other; --across compares them"
    assert side_by_side.of_two_subjects([verdict, verdict]) == ""
    assert side_by_side.of_two_subjects([verdict, named()]) == "", "it measured nothing"


def test_a_machine_that_became_slower_itself_is_said_to() -> None:
    pair = [named(SAME, machine=replace(DESK, reference_ns=ns)) for ns in (100.0, 150.0)]
    section = side_by_side.section(pair, ())
    assert section.conclusions[0].text.startswith("A reference loop takes 1.50 times as long")


def test_one_run_or_three_are_no_pair() -> None:
    assert pair_of([named(SAME)], across=True) == []
    assert pair_of([named(SAME)] * 3, across=True) == []


def test_what_is_the_same_in_both_is_left_out() -> None:
    assert differences(named(SAME), named(SAME)) == {}


def test_numbers_have_a_ratio() -> None:
    rows = differences(named(with_ratio(1.0, 0.9, 1.1)), named(with_ratio(1.2, 0.9, 1.3)))
    assert rows.keys() == {"ratio.estimate", "ratio.high"}
    assert rows["ratio.estimate"].ratio == pytest.approx(1.2)


def test_texts_have_no_ratio() -> None:
    row = differences(named(SAME), named(replace(SAME, detail="late")))["detail"]
    assert (row.old, row.new, row.ratio) == (None, "late", None)


def test_rows_are_compared_with_those_about_the_same() -> None:
    old = named(SAME, of_model(SLOWER, "n"))
    new = named(of_model(replace(SLOWER, launches=99), "n"), SAME)
    (row,) = differences(old, new).values()
    assert row.row.startswith("n, ")
    with pytest.raises(InputError, match="no row in common"):
        differences(named(SAME), named(of_model(SAME, "other")))


def test_what_disturbed_a_run_comes_first() -> None:
    pair = [named(SAME), named(SLOWER, Disturbance([], 0.2))]
    rows = side_by_side.differences(pair[0].run, pair[1].run, across=False)
    section = side_by_side.section(pair, rows)
    assert section.conclusions[0].text.startswith("NEW: Disturbed: the host took 20 %")
    assert section.facts[0].startswith("OLD: run.jsonl")
