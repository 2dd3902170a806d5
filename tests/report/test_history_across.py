"""Histories of several machines: on how many each change is listed."""

from collections.abc import Sequence

import pytest
from speed_histories import history_run

from benchmarks.history import files
from benchmarks.history.speed_history import SpeedHistory
from mjbench.errors import InputError
from mjbench.report import history_across

FLAT = [1.0] * 8
STEP = [1.0] * 4 + [1.1] * 4
DOWN = [1.0] * 4 + [0.9] * 4


def histories(**ratios: Sequence[float]) -> list[SpeedHistory]:
    runs = [history_run(name, values) for name, values in ratios.items()]
    return files.of_runs(runs, None)


def test_a_change_says_on_how_many_machines_it_is_listed() -> None:
    (change,) = history_across.changes(histories(a=STEP, b=STEP, c=STEP, d=FLAT))
    assert change.name == "1.3 → 1.4, pile: slower on 3 of 4"
    assert [cell[:5] for cell in change.cells.values()] == ["+10.0"] * 3 + ["not l"]


def test_machines_that_did_not_measure_both_releases_do_not_count() -> None:
    each = histories(a=STEP, b=FLAT[:4], c=FLAT)
    (change,) = history_across.changes(each)
    assert change.name.endswith("slower on 1 of 2")
    table, _ = history_across.section(each).tables
    (row,) = table.texts
    assert row[1].startswith("+10.0 ±")
    assert row[2:] == ["not listed"]
    assert [column.title for column in table.columns] == ["change", "a", "c"]


def test_directions_are_counted_apart() -> None:
    (change,) = history_across.changes(histories(a=STEP, b=DOWN))
    assert change.name.endswith("slower on 1, faster on 1 of 2")


def test_the_conclusion_counts_changes_by_machines() -> None:
    each = histories(a=STEP, b=STEP)
    assert history_across.conclusion(each, history_across.changes(each)) == (
        "1 change is listed on 2 machines: 1 on all machines that measured them."
    )
    each = histories(a=STEP, b=FLAT)
    text = history_across.conclusion(each, history_across.changes(each))
    assert text.endswith("1 on one machine alone.")


def test_many_machines_have_a_row_each() -> None:
    table, _ = history_across.section(histories(**{f"m{n:010}": STEP for n in range(9)})).tables
    assert [column.title for column in table.columns] == ["change", "machine", "result"]
    assert len(table.rows) == 9


def test_releases_since_one_are_listed_where_any_machine_measured_it() -> None:
    runs = [history_run("a", STEP), history_run("b", FLAT[:2])]
    each = files.of_runs(runs, None, since="1.5")
    assert history_across.changes(each) == []
    with pytest.raises(InputError, match=r"9\.9 was not measured"):
        files.of_runs(runs, None, since="9.9")
