"""What becomes of a model's rows when a child dies, and whose row pays."""

from pathlib import Path

import mujoco
import pytest
from commands import TESTS
from pretender import Pretender

from mjbench.comparison import compare
from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.comparison.records import MeasurementRecord
from mjbench.simulation import models
from mjbench.simulation.engine_clock import has_clock
from mjbench.status import Status


def measured(contact_file: str, *names: str, limit_s: float = 60.0) -> dict[str, MeasurementRecord]:
    plan = ComparisonPlan(
        variants=tuple(Variant(name, {}) for name in ("python_loop", *names)),
        nbatch=3,
        nstep=4,
        budget_s=0.0,
        limit_s=limit_s,
        import_from=str(TESTS),
    )
    records = compare.compare_model(models.resolve(contact_file), plan, lambda name, share: None)
    return {record.path: record for record in records.measurements}


@pytest.mark.parametrize(
    ("name", "status", "detail"),
    [
        ("CrashesWhenTimed", Status.CRASHED, "SIGSEGV) while timing wrong_paths:CrashesWhenTimed"),
        ("HangsWhenTimed", Status.TIMEOUT, "while timing wrong_paths:HangsWhenTimed"),
        ("SharedModel", Status.FAILED, "which all paths share: opt.disableflags while preparing"),
        ("SharedModelWhenTimed", Status.FAILED, "which all paths share: body_mass while timing"),
        ("Crashes", Status.CRASHED, "SIGSEGV) while preparing wrong_paths:Crashes"),
        ("Exits", Status.CRASHED, "exit code 0 while preparing wrong_paths:Exits"),
        ("RaisesWhenTimed", Status.FAILED, "SystemExit: enough while timing wrong_paths:Raises"),
    ],
)
def test_a_path_that_ends_the_child_costs_its_own_row_alone(
    contact_file: str, name: str, status: Status, detail: str
) -> None:
    culprit = f"wrong_paths:{name}"
    limit_s = 3.0 if status == Status.TIMEOUT else 60.0
    rows = measured(contact_file, culprit, "python_loop_hold", limit_s=limit_s)
    assert rows[culprit].status == status
    assert detail in rows[culprit].detail
    assert rows[culprit].samples_s == []
    for name in ("python_loop", "python_loop_hold"):
        assert rows[name].is_timed, rows[name].detail


def test_a_path_that_replays_its_warm_up_is_caught_in_the_first_round(contact_file: str) -> None:
    rows = measured(contact_file, "wrong_paths:MemoWhenTimed", "python_loop_hold")
    assert rows["wrong_paths:MemoWhenTimed"].status == Status.DISAGREES
    assert "in a timed block" in rows["wrong_paths:MemoWhenTimed"].detail
    assert rows["python_loop_hold"].is_timed


def test_paths_are_timed_without_the_engines_clock_too(contact_file: str) -> None:
    if not has_clock(mujoco.MjModel.from_xml_path(contact_file)):
        pytest.skip("this release of MuJoCo has no clock of its own")
    rows = measured(contact_file, "python_loop_hold", "wrong_paths:Elsewhere")
    for name in ("python_loop", "python_loop_hold"):
        assert len(rows[name].with_clock_s) == len(rows[name].without_clock_s) >= 5
    assert rows["wrong_paths:Elsewhere"].with_clock_s == []
    assert rows["wrong_paths:Elsewhere"].is_timed


def test_two_paths_that_end_the_child_cost_two_rows(contact_file: str) -> None:
    names = ("wrong_paths:Crashes", "wrong_paths:CrashesWhenTimed")
    rows = measured(contact_file, *names)
    assert [rows[name].status for name in names] == [Status.CRASHED] * 2
    assert rows["python_loop"].is_timed


def test_a_model_that_cannot_be_loaded_has_rows_that_say_so(tmp_path: Path) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><nothing/></mujoco>")
    rows = measured(str(tmp_path / "broken.xml"), "python_loop_hold")
    assert {row.status for row in rows.values()} == {Status.INPUT}
    assert all("cannot load" in row.detail for row in rows.values())


def test_a_path_that_changes_its_process_is_measured_all_the_same(contact_file: str) -> None:
    rows = measured(contact_file, "wrong_paths:Untidy", "python_loop_hold")
    assert all(row.is_timed for row in rows.values()), [row.detail for row in rows.values()]


def test_an_accelerated_path_that_fails_in_the_parent_costs_its_own_row(
    contact_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: object) -> dict[str, str | None]:
        raise RuntimeError("no environment")

    monkeypatch.setattr(Pretender, "environment", fail)
    rows = measured(contact_file, "pretender:Pretender")
    assert rows["pretender:Pretender"].status == Status.FAILED
    assert rows["pretender:Pretender"].detail == "RuntimeError: no environment"
    assert rows["python_loop"].is_timed
