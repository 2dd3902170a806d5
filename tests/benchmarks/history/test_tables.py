"""Tables of change points."""

from dataclasses import replace

from speed_histories import COUNTED, COUNTS, STEP, VERSIONS, operation_record, record

from benchmarks.history import speed_history, tables
from benchmarks.history.known_causes import KnownCause
from benchmarks.history.speed_history import SpeedHistory
from mjbench.counts.records import Pair
from mjbench.results.content import DataTable

WITH_COUNTS = SpeedHistory([STEP], counts=COUNTED)


def only_row(table: DataTable) -> list[str]:
    (row,) = table.texts
    return row


def test_a_change_point_has_its_cause_and_its_function() -> None:
    row = only_row(tables.step_changes(WITH_COUNTS))
    assert row[:5] == ["1.5 → 1.6", "pile", "+25.0 ±0.1 %", "+20.0 %", "code"]
    assert row[5] == "mj_island +19.0 %"


def test_a_known_cause_is_named_instead_of_functions() -> None:
    known = [KnownCause("1.6", "pile", "", "found by measuring"), KnownCause("1.6", "x", "", "no")]
    known_too = SpeedHistory([STEP], counts=COUNTED, causes=known)
    assert only_row(tables.step_changes(known_too))[5] == "found by measuring"


def test_other_work_accounts_for_a_change() -> None:
    records = [record(v, 1.0) for v in VERSIONS[:6]]
    records += [record(v, 0.8, contacts=1.0) for v in VERSIONS[6:]]
    row = only_row(tables.step_changes(speed_history.from_records(records)))
    assert row[2:5] == ["-20.0 ±0.0 %", "", "work"]
    assert row[5].startswith("contacts 5 → 1; ")


def test_functions_whose_instructions_changed_in_the_other_direction_do_not_account() -> None:
    counts = replace(COUNTS, instructions_per_step=Pair(1000.0, 900.0))
    row = only_row(
        tables.step_changes(SpeedHistory([STEP], counts={("pile", "1.5", "1.6"): counts}))
    )
    assert row[4:] == ["code", "its instructions changed in the other direction"]


def test_operations_have_tables_of_their_own() -> None:
    records = [
        operation_record("rays pile", version, ratio, title="mj_ray")
        for version, ratio in zip(VERSIONS, [1.0] * 6 + [1.5] * 6, strict=True)
    ]
    counts = replace(COUNTS, operation="rays pile", model="pile")
    steps = [record(v, 1.0) for v in VERSIONS]
    around = speed_history.from_records([*records, *steps, counts])
    assert [series.name for series in around.models] == ["pile"]
    row = only_row(tables.operation_changes(around))
    assert row[:4] == ["1.5 → 1.6", "mj_ray, pile", "+50.0 ±0.1 %", "+20.0 %"]
    assert row[5].startswith("mj_island")
    assert around.instructions("pile") == {}, "they are those of the operation"
