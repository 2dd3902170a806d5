"""The page of a history of releases."""

from speed_histories import STEP, history, record

from benchmarks.history import page as of_history
from benchmarks.history import speed_history
from benchmarks.history.speed_history import SpeedHistory
from benchmarks.history.speed_series import SpeedSeries


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
    assert (
        "as in the release before: 3.1.3. The root mean square of their 1 change is 1.00 %" in line
    )
    assert [*of_history.no_change_line(speed_of(STEP))] == []
