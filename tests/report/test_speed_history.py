"""What a page says of the history of the time of a step."""

from speed_histories import VERSIONS, history, record

from mjbench.counts.records import (
    CountedWorkPair,
    CountPair,
    ExplainRecord,
    FunctionDifference,
)
from mjbench.paired.outcomes import Cause
from mjbench.releases.changelog import Changelog, ChangelogItem
from mjbench.releases.speed_history import ModelHistory
from mjbench.report import speed_history, speed_page
from mjbench.report.speed_history import SpeedHistory
from mjbench.status import Status

COUNTS = ExplainRecord(
    model="pile",
    old="1.5",
    new="1.6",
    status=Status.OK,
    instructions_per_step=CountPair(1000.0, 1200.0),
    outside_per_step=CountPair(None, None),
    work=CountedWorkPair(None, None),
    stages={},
    functions=[
        FunctionDifference(name="mj_island", old=100.0, new=290.0, difference=190.0),
        FunctionDifference(name="mj_crb", old=10.0, new=20.0, difference=10.0),
    ],
    time=None,
)
ISLANDS = ChangelogItem("1.6", ("abc1234",), "Constraint islands became the default.")
CHANGELOG = Changelog([ISLANDS, *(ChangelogItem("1.2", (), f"Sensor {i}.") for i in range(99))])
STEP = history([1.0] * 6 + [1.25] * 6)


def speed_of(*models: ModelHistory) -> SpeedHistory:
    return SpeedHistory(models, {}, None)


def test_a_change_point_has_its_cause_its_functions_and_an_item_of_the_changelog() -> None:
    (listed,) = speed_history.listed_changes(
        SpeedHistory([STEP], {("pile", "1.5", "1.6"): COUNTS}, CHANGELOG)
    )
    assert listed.cause == Cause.CODE
    _, _, row = speed_page.changes_table([listed], CHANGELOG)
    assert row.startswith("| 1.5 → 1.6 | `pile` | +25.0 % ±0.1 | +20.0 % | code | ")
    assert "`mj_island` +19.0 %, `mj_crb` +1.0 %" in row
    assert "perhaps: “Constraint islands became the default.” (`abc1234`)" in row


def test_a_change_point_with_other_work_is_due_to_work() -> None:
    records = [record(v, 1.0) for v in VERSIONS[:6]]
    records += [record(v, 0.8, contacts=1.0) for v in VERSIONS[6:]]
    listed = speed_history.listed_changes(speed_history.from_records(records, VERSIONS))
    assert [step.cause for step in listed] == [Cause.WORK]
    (*_, row) = speed_page.changes_table(listed, None)
    assert "| -20.0 % ±0.1 |  | work | contacts 5 → 1" in row


def test_change_points_are_listed_by_release() -> None:
    late, early = history([1.0] * 9 + [1.1] * 3), history([1.0] * 3 + [1.1] * 9)
    listed = speed_history.listed_changes(speed_of(late, early))
    assert [step.after.release for step in listed] == ["1.3", "1.9"]


def test_the_conclusion_counts_models_and_names_the_largest_changes() -> None:
    models = [STEP, history([1.0] * 12), history([1.0] * 11 + [0.5])]
    text = " ".join(speed_page.conclusion(models, speed_history.listed_changes(speed_of(*models))))
    assert "slower for 1 of 3 models (+25.0 %), and faster for 1 (×0.50)" in text
    assert text.endswith("next are ×0.50 for `pile` in 1.11, +25.0 % for `pile` in 1.6.")


def test_a_release_that_is_off_alone_and_a_drift_have_tables_of_their_own() -> None:
    off = history([1.0] * 5 + [1.1] + [1.0] * 6)
    (*_, row) = speed_page.excursions_table(speed_of(off))
    assert row == "| 1.5 | `pile` | +10.0 % | the same |"
    drifting = history([1.01**i for i in range(12)])
    (*_, row) = speed_page.drifts_table(speed_of(drifting))
    assert row == "| 1.0 to 1.11 | `pile` | +11.6 % |"
    (*_, row) = speed_page.totals_table([drifting])
    assert row == "| `pile` | 1.0 | 1.11 | +11.6 % ±0.1 | 0 | the same |"


def test_what_only_the_builds_as_shipped_show_is_placement() -> None:
    records = [record(v, 1.0, shipped=1.04 if i >= 6 else 1.0) for i, v in enumerate(VERSIONS)]
    (*_, row) = speed_page.placement_table(speed_history.from_records(records, VERSIONS))
    assert row == "| 1.6 | `pile` | +4.0 % | +0.0 % |"


def test_a_history_in_which_nothing_happens_says_so() -> None:
    level = speed_of(history([1.0] * 12))
    assert [*speed_page.changes_table(speed_history.listed_changes(level), None)] == [
        "None from 1 % on."
    ]
    for table in (speed_page.excursions_table, speed_page.drifts_table, speed_page.placement_table):
        assert [*table(level)] == ["None."]


def test_only_changes_since_a_release_are_listed() -> None:
    records = [record(v, 1.0 if i < 3 else 1.1 if i < 9 else 1.3) for i, v in enumerate(VERSIONS)]
    for since, expected in ((None, ["1.3", "1.9"]), ("1.4", ["1.9"]), ("1.10", [])):
        steps = speed_history.listed_changes(
            speed_history.from_records(records, VERSIONS, since=since)
        )
        assert [step.after.release for step in steps] == expected


def test_a_page_has_every_section() -> None:
    text = "\n".join(speed_page.lines(speed_of(STEP)))
    assert text.startswith(
        "From the first release measured to the last, a step became slower for 1"
    )
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## Change points",
        "## Single releases that are off",
        "## Drifts",
        "## Changed by placement",
        "## From the first release to the last",
        "## Time of a step",
        "## Instructions of a step",
        "## Releases that compute something else",
    ]


def test_times_are_ratios_times_the_time_of_the_reference_with_change_points_marked() -> None:
    rows = [*speed_page.times_table(speed_of(STEP))]
    assert rows[2 + 5] == "| 1.5 | 2 |"
    assert rows[2 + 6] == "| 1.6 | 2.5▲ |"
    assert rows[2 + 7] == "| 1.7 | 2.5 |"


def test_instructions_have_a_row_for_each_release_that_was_measured() -> None:
    counted = SpeedHistory([STEP], {("pile", "1.5", "1.6"): COUNTS}, None)
    rows = [*speed_page.instructions_table(counted)]
    assert rows[2 + 4 : 2 + 7] == ["| 1.4 | – |", "| 1.5 | 1 |", "| 1.6 | 1.2▲ |"]
    (none,) = speed_page.instructions_table(speed_of(STEP))
    assert none.startswith("Not counted; ")


def test_work_has_a_row_for_each_release_that_changed_it() -> None:
    records = [record(v, 1.0, contacts=1.0 if v < "1.5" else 5.0) for v in ("1.4", "1.5", "1.6")]
    more = [record(v, 1.0, model="cloth", drift=float(v == "1.5")) for v in ("1.4", "1.5")]
    (*_, row) = speed_page.work_table(speed_history.from_records([*records, *more], VERSIONS))
    assert row.startswith("| 1.5 | `cloth`: different result of one step<br>`pile`: contacts 1 → 5")
    assert [*speed_page.work_table(speed_of(STEP))] == ["None."]


def test_releases_of_all_models_are_in_order() -> None:
    records = [record(v, 1.0, model="cloth") for v in ("1.3", "1.5")]
    records += [record(v, 1.0, model="pile") for v in ("1.0", "1.2", "1.5", "1.7", "1.10")]
    history_of_both = speed_history.from_records(records, VERSIONS)
    assert history_of_both.releases() == ["1.0", "1.2", "1.3", "1.5", "1.7", "1.10"]
    since = speed_history.from_records(records, VERSIONS, since="1.5")
    _, _, *rows = speed_page.times_table(since)
    assert [row.split()[1] for row in rows] == ["1.5", "1.7", "1.10"]
