"""Environments are measured in child processes, and the record says how those ended."""

import dataclasses
from typing import Any

import pytest
from commands import PYTHONPATH, TESTS
from example_environment_records import record as invented_record

from mjbench.commands.env import driver
from mjbench.commands.env.child_process import EnvironmentPlan
from mjbench.commands.env.layers import Layer
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.env.source import resolve
from mjbench.status import Status

PLAN = EnvironmentPlan(nstep=40, seed=0, threads=(1, 2), nenv=(), budget_s=0.0, limit_s=60.0)


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)


def measured(factory: str, **plan: Any) -> EnvironmentRecord:
    source = resolve(f"example_environments:{factory}", TESTS)
    return driver.measure(source, dataclasses.replace(PLAN, **plan))


def test_an_environment_is_measured_and_compared() -> None:
    record = measured("wrapped")
    assert (record.status, record.detail) == (Status.OK, "")
    assert record.facts.wrappers == ["Outer", "Wrapper"]
    assert (record.facts.nstep, record.facts.nepisode) == (40, 3)
    assert record.facts.episode_nstep == 15.0
    assert record.facts.calls == ["mj_step(nstep=4)"]
    assert (record.check.status, record.check.checked, record.check.covered) == (Status.OK, 40, 40)
    rounds = len(record.step_ns)
    assert rounds >= 7
    for samples in (record.compared_ns, record.reset_ns, record.layered_ns, record.cores):
        assert len(samples) == rounds
        assert min(samples) > 0
    assert {layer.layer for layer in record.layers} >= {Layer.PHYSICS, Layer.WRAPPERS, Layer.REWARD}
    for layer in record.layers:
        assert len(layer.ns) == rounds
    sums = [sum(ns) for ns in zip(*(layer.ns for layer in record.layers), strict=True)]
    assert sums == pytest.approx(record.layered_ns)
    assert record.paths[0].path == "python_loop"
    for path in record.paths:
        assert path.status in (Status.OK, Status.UNAVAILABLE)
        assert len(path.ns) == (rounds if path.status == Status.OK else 0)


def test_another_framework_is_measured_as_well(inline: None) -> None:
    record = measured("robosuite")
    assert (record.status, record.facts.framework) == (Status.OK, "robosuite")
    assert record.facts.calls == ["4 × (mj_step1, mj_step2)"]
    assert record.check.status == Status.OK


@pytest.mark.parametrize(
    ("factory", "status", "detail"),
    [
        ("Unseeded", Status.UNAVAILABLE, "its physics is not the same again"),
        ("StaleStart", Status.DISAGREES, "qpos[7] is "),
    ],
)
def test_what_cannot_be_compared_has_its_reason(
    factory: str, status: Status, detail: str, inline: None
) -> None:
    record = measured(factory)
    assert (record.status, record.check.status) == (Status.OK, status)
    assert detail in record.check.detail
    assert len(record.step_ns) >= 7  # its own times are there
    assert not record.paths


def test_physics_is_compared_where_only_what_steps_return_does_not_repeat(inline: None) -> None:
    record = measured("remembering")
    assert [each.field for each in record.facts.unrepeated] == ["observation"]
    assert not record.facts.repeats
    assert record.check.status == Status.OK
    assert record.paths[0].ns


@pytest.mark.parametrize(
    ("factory", "detail"),
    [
        ("Raises", "its step raised KeyError: 'no such sensor' (example_environments.py:"),
        ("number", "int is no environment"),
        ("Forwards", "none of its 40 steps called mj_step, mj_step1 or mj_step2"),
        ("NoPhysics", "no MuJoCo physics: none of its 40 steps called the engine"),
        ("mak", "did you mean make"),
    ],
)
def test_what_is_wrong_with_an_environment_is_one_line(
    factory: str, detail: str, inline: None
) -> None:
    record = measured(factory)
    assert record.status == Status.INPUT
    assert detail in record.detail
    assert record.detail.isprintable()
    assert record.facts is None


def test_times_of_rounds_that_do_not_fit_together_are_refused() -> None:
    whole = invented_record()
    for change in (
        {"reset_ns": whole.reset_ns[:-1]},
        {"timer_cost": None},
        {"compared_ns": ()},
        {"layers": [dataclasses.replace(whole.layers[0], ns=[1.0])]},
    ):
        with pytest.raises(ValueError, match=r"differ in length|missing"):
            dataclasses.replace(whole, **change)
    with pytest.raises(ValueError, match="differ in length"):
        dataclasses.replace(whole.vectors[0], ns=[1.0])


def test_an_environment_that_hangs_is_killed() -> None:
    record = measured("Hangs", limit_s=5.0)
    assert record.status == Status.TIMEOUT
    assert "killed (--time-limit) while recording the steps of the environment" in record.detail


def test_an_environment_that_crashes_ends_its_own_process_alone() -> None:
    record = measured("crashes")
    assert record.status == Status.CRASHED
    assert "SIGSEGV" in record.detail
