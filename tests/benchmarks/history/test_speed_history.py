"""The change points of a history of releases, and what is known of each."""

from dataclasses import replace

from speed_histories import VERSIONS, history, record

from benchmarks.history import speed_history
from benchmarks.history.speed_history import Listed, SpeedHistory
from benchmarks.history.speed_series import SpeedSeries
from mjbench.paired.outcomes import Cause


def speed_of(*models: SpeedSeries) -> SpeedHistory:
    return SpeedHistory(models)


def listed_in(history: SpeedHistory) -> list[Listed]:
    return speed_history.listed_changes(history, history.models)


def test_a_change_whose_work_or_placement_is_not_known_is_undecided() -> None:
    for unknown in ({"work": None}, {"problem": "it cannot be moved"}):
        records = [replace(record(v, 1.0), **unknown) for v in VERSIONS[:6]]
        records += [record(v, 0.8) for v in VERSIONS[6:]]
        changed = speed_history.from_records(records)
        assert [step.cause for step in listed_in(changed)] == [Cause.UNDECIDED]


def test_change_points_are_listed_by_release() -> None:
    late, early = history([1.0] * 9 + [1.1] * 3), history([1.0] * 3 + [1.1] * 9)
    both = speed_of(late, early)
    assert [step.after.release for step in listed_in(both)] == ["1.3", "1.9"]


def test_releases_of_all_models_are_in_order() -> None:
    records = [record(v, 1.0, model="cloth") for v in ("1.3", "1.5")]
    records += [record(v, 1.0, model="pile") for v in ("1.0", "1.2", "1.5", "1.7", "1.10")]
    history_of_both = speed_history.from_records(records)
    assert history_of_both.releases() == ["1.0", "1.2", "1.3", "1.5", "1.7", "1.10"]
