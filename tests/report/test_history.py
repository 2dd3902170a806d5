"""What a history of releases comes to, and each release of the committed one."""

from speed_histories import STEP, history, record

from benchmarks.history import page as of_history
from benchmarks.history import speed_history
from benchmarks.history.speed_history import SpeedHistory
from benchmarks.history.speed_series import SpeedSeries
from mjbench.status import Status


def speed_of(*models: SpeedSeries) -> SpeedHistory:
    return SpeedHistory(models)


def notes_of(history: SpeedHistory) -> str:
    overview, *_ = of_history.sections(history)
    return " ".join(overview.notes)


def test_the_conclusion_counts_models_and_names_the_largest_changes() -> None:
    models = [STEP, history([1.0] * 12), history([1.0] * 11 + [0.5])]
    text = " ".join(of_history.conclusions(speed_of(*models)))
    assert "slower for 1 of 3 models (+25.0 %), and faster for 1 (×0.50). For 1 the" in text
    assert text.endswith("next are ×0.50 for pile in 1.11, +25.0 % for pile in 1.6.")


def test_a_range_of_changes_goes_from_the_smallest_to_the_largest() -> None:
    models = [history([1.0] * 6 + [1.0 + i / 10] * 6) for i in (3, 1, 2)]
    text = " ".join(of_history.conclusions(speed_of(*models)))
    assert "slower for 3 of 3 models (+10.0 % to +30.0 %)" in text


def test_a_section_of_what_did_not_happen_says_so() -> None:
    level = {each.heading: each for each in of_history.sections(speed_of(history([1.0] * 12)))}
    assert list(level["Change points of a step"].notes) == ["None from 1 % on."]
    assert list(level["Drifts"].notes) == ["None."]
    assert level["Instructions of a step"].notes[0].startswith("Not counted; ")
    assert not any(level[name].tables for name in ("Change points of a step", "Drifts"))


def test_the_notes_say_how_far_the_reference_is_from_itself() -> None:
    records = [record("1.0", 1.0), record("4.0.0", 0.98), record("4.0.0", 1.01, model="cloth")]
    text = notes_of(speed_history.from_records(records))
    assert "against itself should differ by 0 %; it differs by -2 % to 1 %" in text
    assert "against itself" not in notes_of(speed_of(STEP))


def test_pairs_without_a_change_say_how_exact_the_history_is() -> None:
    releases = ["3.1.1", "3.1.2", "3.1.3", "3.1.4"]
    ratios = (1.0, 1.0, 1.01, 1.01)
    records = [record(v, r) for v, r in zip(releases, ratios, strict=True)]
    (line,) = of_history.no_change_line(speed_history.from_records(records))
    assert "as in the one before: 3.1.3. The root mean square of their 1 change is 1.00 %" in line
    assert [*of_history.no_change_line(speed_of(STEP))] == []


def test_there_is_a_section_of_everything_that_there_are_data_for() -> None:
    headings = [section.heading for section in of_history.sections(speed_of(STEP), False)]
    assert headings == [
        "What changed between releases",
        "Change points of a step",
        "Single releases that are off",
        "Drifts",
        "Changed by placement",
        "From the first release to the last",
        "Time of a step",
        "Instructions of a step",
        "Releases that compute something else",
    ]
    crashed = record("1.3", 1.0, status=Status.CRASHED)
    failing = speed_history.from_records([record("1.2", 1.0), crashed])
    *_, plots_and_more = of_history.sections(failing)
    assert plots_and_more.heading == "Measurements that failed"


def test_every_section_has_the_command_that_gives_its_figures() -> None:
    sections = list(of_history.sections(speed_of(STEP)))
    assert all(section.command.startswith("mjbench history ") for section in sections)
    (plots,) = [section for section in sections if section.figures]
    assert [figure.title for figure in plots.figures] == ["pile"]
