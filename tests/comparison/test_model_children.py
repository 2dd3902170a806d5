"""Paths of a model are verified in a child; see `api/test_compare` for what ends it."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from commands import TESTS

from mjbench.comparison import accelerated_measurement
from mjbench.comparison.messages import ModelFiles
from mjbench.comparison.model_children import ModelChildren
from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.comparison.records import MeasurementRecord
from mjbench.host import isolate
from mjbench.simulation import models
from mjbench.simulation.workload import Product
from mjbench.status import Status


def children(folder: Path, model: str, *names: str, **plan: Any) -> ModelChildren:
    variants = tuple(Variant(name, {}) for name in ("python_loop", *names))
    usual = {"nbatch": 3, "nstep": 4, "limit_s": 60.0, "import_from": str(TESTS)}
    asked = ComparisonPlan(variants=variants, **{**usual, **plan})
    return ModelChildren(models.resolve(model), asked, ModelFiles.in_folder(folder))


def verified(folder: Path, model: str, *names: str, **plan: Any) -> ModelChildren:
    of_model = children(folder, model, *names, **plan)
    of_model.verify(lambda: None)
    return of_model


def rows_of(of_model: ModelChildren) -> dict[str, MeasurementRecord]:
    """Return the records as if a race had timed all that agrees."""
    return {
        record.path: record for record in of_model.measurements(of_model.agreeing, is_over=True)
    }


def test_a_path_that_hangs_costs_its_own_row_alone(tmp_path: Path, contact_file: str) -> None:
    culprit = "wrong_paths:Hangs"
    of_model = verified(tmp_path, contact_file, culprit, "python_loop_hold", limit_s=3.0)
    rows = rows_of(of_model)
    assert rows[culprit].status == Status.TIMEOUT
    assert "no answer within 3 s" in rows[culprit].detail
    assert of_model.agreeing == [0, 2]
    assert of_model.model_record().status == Status.OK


def test_a_path_that_does_not_return_what_is_asked_for_is_unavailable(
    tmp_path: Path, contact_file: str, inline: None
) -> None:
    plan = {"returns": Product.SENSORS, "hold": 2}
    of_model = verified(tmp_path, contact_file, "python_loop_hold", **plan)
    row = rows_of(of_model)["python_loop_hold"]
    assert row.status == Status.UNAVAILABLE
    assert "returns no state between" in row.detail
    assert of_model.model_record().returns == Product.SENSORS


@pytest.mark.parametrize(
    ("text", "limit_s", "status", "detail"),
    [
        (
            "<mujoco><option timestep='.1'/><worldbody><body><joint name='j' type='slide'"
            " stiffness='1e9'/><geom size='.1' mass='.001'/></body></worldbody></mujoco>",
            60.0,
            Status.INPUT,
            "diverges",
        ),
        (
            "<mujoco><option solver='PGS' iterations='2147483647' tolerance='0'"
            " noslip_iterations='2147483647'/><worldbody><geom type='plane' size='1 1 1'/>"
            "<body pos='0 0 .099'><freejoint/><geom type='box' size='.1 .1 .1'/></body>"
            "</worldbody></mujoco>",
            3.0,
            Status.TIMEOUT,
            "no answer within 3 s",
        ),
    ],
)
def test_a_model_that_cannot_be_stepped_has_rows_that_say_so(
    tmp_path: Path, text: str, limit_s: float, status: Status, detail: str
) -> None:
    (tmp_path / "m.xml").write_text(text)
    model = str(tmp_path / "m.xml")
    of_model = verified(tmp_path, model, "python_loop_hold", limit_s=limit_s)
    rows = rows_of(of_model).values()
    assert {row.status for row in rows} == {of_model.model_record().status} == {status}
    assert all(detail in row.detail for row in rows)


def test_simulations_that_diverge_are_left_out_and_counted(tmp_path: Path, inline: None) -> None:
    # unstable only where the random start velocity is positive: it leaves a spring-free stretch
    (tmp_path / "edge.xml").write_text(
        "<mujoco><option timestep='.05' gravity='0 0 0'><flag contact='disable'/></option>"
        "<worldbody><body><joint name='a' type='slide' axis='1 0 0'/><geom size='.1'/></body>"
        "<body pos='0 1 0'><joint name='b' type='slide' axis='1 0 0' limited='true' range='-9 0'"
        " solreflimit='-1e7 -1'/><geom size='.1' mass='.01'/></body></worldbody>"
        "<keyframe><key qpos='0 -.0003'/></keyframe></mujoco>"
    )
    of_model = verified(tmp_path, str(tmp_path / "edge.xml"), nbatch=64, nstep=30)
    record = of_model.model_record()
    assert record.diverged is not None
    assert 0 < record.diverged < 64, "the model no longer diverges in part"
    assert record.nbatch == 64 - record.diverged
    assert of_model.agreeing == [0]


def test_a_path_that_did_not_race_says_that_it_was_not_timed(
    tmp_path: Path, contact_file: str, inline: None
) -> None:
    of_model = verified(tmp_path, contact_file, "python_loop_hold")
    first, second = of_model.measurements([0], is_over=True)
    assert first.status == Status.OK
    assert (second.status, second.detail) == (Status.FAILED, "it was not timed")
    assert of_model.measurements([0], is_over=False)[1].status == Status.INTERRUPTED


@pytest.mark.parametrize(
    ("compile_s", "detail"),
    [(None, "not compiled within 300 s"), (12.0, "no answer, killed")],
)
def test_a_compiler_that_takes_too_long_bounds_what_the_path_costs(
    tmp_path: Path,
    contact_file: str,
    monkeypatch: pytest.MonkeyPatch,
    compile_s: float | None,
    detail: str,
) -> None:
    of_model = children(tmp_path, contact_file, "mjx", limit_s=60.0)

    def run(request: Any, on_record: Any, import_from: Any) -> isolate.Ended:
        if compile_s is not None:
            record = MeasurementRecord.of("m", request.variant)
            on_record(dataclasses.replace(record, compile_s=compile_s))
        return isolate.Ended(Status.TIMEOUT, "no answer, killed (--time-limit)")

    monkeypatch.setattr(accelerated_measurement, "run", run)
    of_model.run_accelerated(1)
    row = of_model.measured[1]
    assert (row.status, row.samples_s) == (Status.TIMEOUT, ())
    assert detail in row.detail
