"""What a page says of the history of the time of a step."""

from dataclasses import replace

import pytest
from speed_histories import VERSIONS, history, record

from mjbench.counts.records import (
    CodeChange,
    CodeShare,
    ExplainRecord,
    FunctionDifference,
    Pair,
)
from mjbench.paired.outcomes import Cause
from mjbench.releases.known_causes import KnownCause
from mjbench.releases.release_ratios import OperationRatioRecord
from mjbench.releases.speed_history import SpeedSeries
from mjbench.report import speed_history, speed_page, speed_tables
from mjbench.report.speed_history import Background, Listed, SpeedHistory
from mjbench.status import Status

COUNTS = ExplainRecord(
    model="pile",
    old="1.5",
    new="1.6",
    status=Status.OK,
    instructions_per_step=Pair(1000.0, 1200.0),
    outside_per_step=Pair(None, None),
    work=Pair(None, None),
    stages={},
    functions=[
        FunctionDifference(name="mj_island", old=100.0, new=290.0, difference=190.0),
        FunctionDifference(name="mj_crb", old=10.0, new=20.0, difference=10.0),
    ],
    time=None,
)
STEP = history([1.0] * 6 + [1.25] * 6)


COUNTED = Background({("pile", "1.5", "1.6"): COUNTS})


def speed_of(*models: SpeedSeries) -> SpeedHistory:
    return SpeedHistory(models)


def listed_in(history: SpeedHistory) -> list[Listed]:
    return speed_history.listed_changes(history, history.models)


def test_a_change_point_has_its_cause_and_its_functions() -> None:
    history_of_step = SpeedHistory([STEP], background=COUNTED)
    (listed,) = listed_in(history_of_step)
    assert listed.cause == Cause.CODE
    _, _, row = speed_tables.step_changes(history_of_step)
    assert row.startswith("| 1.5 → 1.6 | `pile` | +25.0 ±0.1 % | +20.0 % | code | ")
    assert "`mj_island` +19.0 %, `mj_crb` +1.0 %" in row


def test_a_known_cause_follows_the_functions() -> None:
    known = [KnownCause("1.6", "pile", "", "found by measuring"), KnownCause("1.6", "x", "", "no")]
    background = replace(COUNTED, causes=known)
    _, _, row = speed_tables.step_changes(SpeedHistory([STEP], background=background))
    assert row.endswith("`mj_crb` +1.0 %<br>found by measuring |")


def test_a_change_point_with_other_work_is_due_to_work() -> None:
    records = [record(v, 1.0) for v in VERSIONS[:6]]
    records += [record(v, 0.8, contacts=1.0) for v in VERSIONS[6:]]
    changed = speed_history.from_records(records)
    assert [step.cause for step in listed_in(changed)] == [Cause.WORK]
    (*_, row) = speed_tables.step_changes(changed)
    assert "| -20.0 ±0.0 % |  | work | contacts 5 → 1" in row


@pytest.mark.parametrize(
    ("change", "cause"), [(CodeChange.OFFSETS, Cause.UNDECIDED), (CodeChange.CHANGED, Cause.CODE)]
)
def test_the_same_machine_code_is_no_cause(change: CodeChange, cause: Cause) -> None:
    counts = replace(
        COUNTS, code={CodeChange.IDENTICAL: CodeShare(9, 0.9), change: CodeShare(1, 0.1)}
    )
    background = Background({("pile", "1.5", "1.6"): counts})
    history_of_step = SpeedHistory([STEP], background=background)
    assert [step.cause for step in listed_in(history_of_step)] == [cause]
    (*_, row) = speed_tables.step_changes(history_of_step)
    assert ("both execute the same machine code" in row) == (cause == Cause.UNDECIDED)


def test_a_change_whose_work_or_placement_is_not_known_is_undecided() -> None:
    for unknown in ({"work": None}, {"problem": "it cannot be moved"}):
        records = [replace(record(v, 1.0), **unknown) for v in VERSIONS[:6]]
        records += [record(v, 0.8) for v in VERSIONS[6:]]
        changed = speed_history.from_records(records)
        assert [step.cause for step in listed_in(changed)] == [Cause.UNDECIDED]


def test_change_points_are_listed_by_release() -> None:
    late, early = history([1.0] * 9 + [1.1] * 3), history([1.0] * 3 + [1.1] * 9)
    listed = listed_in(speed_of(late, early))
    assert [step.after.release for step in listed] == ["1.3", "1.9"]


def test_the_conclusion_counts_models_and_names_the_largest_changes() -> None:
    models = [STEP, history([1.0] * 12), history([1.0] * 11 + [0.5])]
    text = " ".join(speed_page.conclusion(speed_of(*models)))
    assert "slower for 1 of 3 models (+25.0 %), and faster for 1 (×0.50). For 1 the" in text
    assert text.endswith("next are ×0.50 for `pile` in 1.11, +25.0 % for `pile` in 1.6.")


def test_functions_whose_instructions_changed_in_the_other_direction_do_not_account() -> None:
    counts = replace(COUNTS, instructions_per_step=Pair(1000.0, 900.0))
    background = Background({("pile", "1.5", "1.6"): counts})
    (*_, row) = speed_tables.step_changes(SpeedHistory([STEP], background=background))
    assert row.endswith("| code | its instructions changed in the other direction |")


def test_what_a_release_crashed_in_has_a_row_until_it_was_measured() -> None:
    crashed = replace(record("1.3", 1.0, status=Status.CRASHED), detail="signal 11")
    records = [record("1.2", 1.0), crashed]
    failing = speed_history.from_records(records)
    assert [*speed_tables.failures(failing)][-1] == "| 1.3 | `pile` | signal 11 |"
    assert "## Measurements that failed" in "\n".join(speed_page.lines(failing))
    assert not speed_history.from_records([*records, record("1.3", 1.0)]).failures


def test_a_count_is_marked_only_against_the_release_right_before() -> None:
    gap = replace(COUNTS, old="1.8", new="1.9", instructions_per_step=Pair(2000.0, 2000.0))
    counts = {("pile", "1.5", "1.6"): COUNTS, ("pile", "1.8", "1.9"): gap}
    rows = [*speed_tables.instructions(SpeedHistory([STEP], background=Background(counts)))]
    assert rows[2 + 6 : 2 + 9] == ["| 1.6 | 1.2▲ |", "| 1.7 | – |", "| 1.8 | 2 |"]


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
    (*_, row) = speed_tables.operation_changes(around)
    assert row.startswith(
        "| 1.5 → 1.6 | mj_ray, `pile` | +50.0 ±0.1 % | +20.0 % | code | `mj_island`"
    )
    assert around.instructions("pile") == {}, "they are those of the operation"
    rows = [*speed_tables.times(around, around.operations)]
    assert rows[2 + 6] == "| 1.6 | 4.5▲ |"


def test_a_release_that_is_off_alone_and_a_drift_have_tables_of_their_own() -> None:
    off = history([1.0] * 5 + [1.1] + [1.0] * 6)
    (*_, row) = speed_tables.excursions(speed_of(off))
    assert row == "| 1.5 | `pile` | +10.0 % | the same |"
    drifting = history([1.01**i for i in range(12)])
    (*_, row) = speed_tables.drifts(speed_of(drifting))
    assert row == "| 1.0 to 1.11 | `pile` | +11.6 % |"
    (*_, row) = speed_tables.totals([drifting])
    assert row == "| `pile` | 1.0 | 1.11 | +11.6 ±0.2 % | 0 | the same |"


def test_what_only_the_builds_as_shipped_show_is_placement() -> None:
    records = [record(v, 1.0, shipped=1.04 if i >= 6 else 1.0) for i, v in enumerate(VERSIONS)]
    (*_, row) = speed_tables.placement(speed_history.from_records(records))
    assert row == "| 1.6 | `pile` | +4.0 % | +0.0 % |"


def test_a_history_in_which_nothing_happens_says_so() -> None:
    level = speed_of(history([1.0] * 12))
    assert [*speed_tables.step_changes(level)] == ["None from 1 % on."]
    assert [*speed_tables.operation_changes(level)] == ["None from 1 % on."]
    for table in (speed_tables.excursions, speed_tables.drifts, speed_tables.placement):
        assert [*table(level)] == ["None."]


def test_the_page_says_how_far_the_reference_is_from_itself() -> None:
    records = [record("1.0", 1.0), record("4.0.0", 0.98), record("4.0.0", 1.01, model="cloth")]
    text = " ".join(speed_page.provenance(speed_history.from_records(records)))
    assert "against itself should differ by 0 %; it differs by -2 % to 1 %" in text
    assert "against itself" not in " ".join(speed_page.provenance(speed_of(STEP)))


def test_pairs_without_a_change_say_how_exact_the_history_is() -> None:
    releases = ["3.1.1", "3.1.2", "3.1.3", "3.1.4"]
    ratios = (1.0, 1.0, 1.01, 1.01)
    records = [record(v, r) for v, r in zip(releases, ratios, strict=True)]
    (line,) = speed_page.no_change_line(speed_history.from_records(records, releases))
    assert "as in the one before: 3.1.3. The root mean square of their 1 change is 1.00 %" in line
    assert [*speed_page.no_change_line(speed_of(STEP))] == []


def test_only_changes_since_a_release_are_listed() -> None:
    records = [record(v, 1.0 if i < 3 else 1.1 if i < 9 else 1.3) for i, v in enumerate(VERSIONS)]
    for since, expected in ((None, ["1.3", "1.9"]), ("1.4", ["1.9"]), ("1.10", [])):
        steps = listed_in(speed_history.from_records(records, since=since))
        assert [step.after.release for step in steps] == expected


def test_a_page_has_every_section_that_it_has_data_for() -> None:
    text = "\n".join(speed_page.lines(speed_of(STEP)))
    assert text.startswith("From the first release that loads a model to the last, a step became")
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## Change points of a step",
        "## Single releases that are off",
        "## Drifts",
        "## Changed by placement",
        "## From the first release to the last",
        "## Time of a step",
        "## Instructions of a step",
        "## Releases that compute something else",
    ]


def test_times_are_ratios_times_the_time_of_the_reference_with_change_points_marked() -> None:
    rows = [*speed_tables.times(speed_of(STEP), [STEP])]
    assert rows[2 + 5] == "| 1.5 | 2 |"
    assert rows[2 + 6] == "| 1.6 | 2.5▲ |"
    assert rows[2 + 7] == "| 1.7 | 2.5 |"


def test_instructions_have_a_row_for_each_release_that_was_measured() -> None:
    rows = [*speed_tables.instructions(SpeedHistory([STEP], background=COUNTED))]
    assert rows[2 + 4 : 2 + 7] == ["| 1.4 | – |", "| 1.5 | 1 |", "| 1.6 | 1.2▲ |"]
    (none,) = speed_tables.instructions(speed_of(STEP))
    assert none.startswith("Not counted; ")


def test_work_has_a_row_for_each_release_that_changed_it() -> None:
    records = [record(v, 1.0, contacts=1.0 if v < "1.5" else 5.0) for v in ("1.4", "1.5", "1.6")]
    more = [record(v, 1.0, model="cloth", drift=float(v == "1.5")) for v in ("1.4", "1.5")]
    (*_, row) = speed_tables.work(speed_history.from_records([*records, *more]))
    assert row.startswith(
        "| 1.5 | `pile`: contacts 1 → 5, constraints 4 → 20<br>`cloth`: different result"
    )
    assert [*speed_tables.work(speed_of(STEP))] == ["None."]


def test_releases_of_all_models_are_in_order() -> None:
    records = [record(v, 1.0, model="cloth") for v in ("1.3", "1.5")]
    records += [record(v, 1.0, model="pile") for v in ("1.0", "1.2", "1.5", "1.7", "1.10")]
    history_of_both = speed_history.from_records(records)
    assert history_of_both.releases() == ["1.0", "1.2", "1.3", "1.5", "1.7", "1.10"]
    since = speed_history.from_records(records, since="1.5")
    _, _, *rows = speed_tables.times(since, since.models)
    assert [row.split()[1] for row in rows] == ["1.5", "1.7", "1.10"]


def test_every_section_carries_the_command_that_gives_its_figures() -> None:
    text = "\n".join(speed_page.lines(speed_of(STEP), plots="plots"))
    _, *sections = text.split("\n## ")
    for section in sections:
        assert section.rstrip().rpartition("\n")[2].startswith("From `mjbench history "), section
    assert "![pile](plots/pile.svg)" in text
