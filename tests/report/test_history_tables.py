"""The tables of a history of releases."""

from dataclasses import replace

from speed_histories import COUNTED, COUNTS, STEP, VERSIONS, history, record

from benchmarks.history import speed_history
from benchmarks.history import tables as tables
from benchmarks.history.known_causes import KnownCause
from benchmarks.history.release_ratios import OperationRatioRecord
from benchmarks.history.speed_series import SpeedSeries
from mjbench.counts.records import Pair
from mjbench.report.content import DataTable
from mjbench.status import Status

WITH_COUNTS = SpeedHistory([STEP], counts=COUNTED)


def speed_of(*models: SpeedSeries) -> SpeedHistory:
    return SpeedHistory(models)


def only_row(table: DataTable) -> list[str]:
    (row,) = table.texts
    return row


def test_a_change_point_has_its_cause_and_its_functions() -> None:
    row = only_row(tables.step_changes(WITH_COUNTS))
    assert row[:5] == ["1.5 → 1.6", "pile", "+25.0 ±0.1 %", "+20.0 %", "code"]
    assert row[5] == "mj_island +19.0 %, mj_crb +1.0 %"


def test_a_known_cause_follows_the_functions() -> None:
    known = [KnownCause("1.6", "pile", "", "found by measuring"), KnownCause("1.6", "x", "", "no")]
    known_too = SpeedHistory([STEP], counts=COUNTED, causes=known)
    assert only_row(tables.step_changes(known_too))[5].endswith("mj_crb +1.0 %; found by measuring")


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


def test_what_a_release_crashed_in_has_a_row() -> None:
    crashed = replace(record("1.3", 1.0, status=Status.CRASHED), detail="signal 11")
    failing = speed_history.from_records([record("1.2", 1.0), crashed])
    assert only_row(tables.failures(failing)) == ["1.3", "pile", "signal 11"]


def test_a_count_is_marked_only_against_the_release_right_before() -> None:
    gap = replace(COUNTS, old="1.8", new="1.9", instructions_per_step=Pair(2000.0, 2000.0))
    counts = {**COUNTED, ("pile", "1.8", "1.9"): gap}
    rows = tables.instructions(SpeedHistory([STEP], counts=counts)).texts
    assert rows[6:9] == [["1.6", "1.2▲"], ["1.7", "–"], ["1.8", "2"]]


def test_operations_have_tables_of_their_own() -> None:
    records = [
        OperationRatioRecord(
            operation="rays pile",
            title="mj_ray",
            model="pile",
            release=version,
            build=version,
            reference="4.0.0",
            status=Status.OK,
            launches=record(version, ratio).launches,
            drift=0.0,
            reference_s=3e-6,
        )
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
    assert tables.operation_times(around).texts[6] == ["1.6", "4.5▲"]


def test_a_release_that_is_off_alone_and_a_drift_have_tables_of_their_own() -> None:
    off = history([1.0] * 5 + [1.1] + [1.0] * 6)
    assert only_row(tables.excursions(speed_of(off))) == ["1.5", "pile", "+10.0 %", "the same"]
    drifting = speed_of(history([1.01**i for i in range(12)]))
    assert only_row(tables.drifts(drifting)) == ["1.0 to 1.11", "pile", "+11.6 %"]
    total = ["pile", "1.0", "1.11", "+11.6 ±0.2 %", "0", "the same"]
    assert only_row(tables.totals(drifting)) == total


def test_what_only_the_builds_as_shipped_show_is_placement() -> None:
    records = [record(v, 1.0, shipped=1.04 if i >= 6 else 1.0) for i, v in enumerate(VERSIONS)]
    table = tables.placement(speed_history.from_records(records))
    assert only_row(table) == ["1.6", "pile", "+4.0 %", "+0.0 %"]


def test_a_history_in_which_nothing_happens_has_empty_tables() -> None:
    level = speed_of(history([1.0] * 12))
    for table in (
        *(tables.step_changes, tables.operation_changes, tables.excursions, tables.drifts),
        *(tables.placement, tables.work, tables.instructions),
    ):
        assert not table(level).rows


def test_times_are_ratios_times_the_time_of_the_reference_with_change_points_marked() -> None:
    table = tables.step_times(speed_of(STEP))
    assert table.texts[5:8] == [["1.5", "2"], ["1.6", "2.5▲"], ["1.7", "2.5"]]
    assert table.columns[1].is_number


def test_instructions_have_a_row_for_each_release_that_was_measured() -> None:
    rows = tables.instructions(WITH_COUNTS).texts
    assert rows[4:7] == [["1.4", "–"], ["1.5", "1"], ["1.6", "1.2▲"]]


def test_work_has_a_row_for_each_release_and_model_in_which_it_changed() -> None:
    records = [record(v, 1.0, contacts=1.0 if v < "1.5" else 5.0) for v in ("1.4", "1.5", "1.6")]
    more = [record(v, 1.0, model="cloth", drift=float(v == "1.5")) for v in ("1.4", "1.5")]
    pile, cloth = tables.work(speed_history.from_records([*records, *more])).texts
    assert pile == ["1.5", "pile", "contacts 1 → 5, constraints 4 → 20"]
    assert cloth[:2] == ["1.5", "cloth"]
    assert cloth[2].startswith("different result")


def test_releases_since_one_have_rows() -> None:
    records = [record(v, 1.0) for v in ("1.0", "1.5", "1.7", "1.10")]
    since = speed_history.from_records(records, since="1.5")
    assert [row[0] for row in tables.step_times(since).texts] == ["1.5", "1.7", "1.10"]
