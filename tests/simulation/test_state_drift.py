"""Targets are compared at several points of a run, and chaos is told from changed code."""

import dataclasses

import mujoco
import numpy as np
import pytest

from mjbench.simulation import changed_work, models, state_drift, workload
from mjbench.simulation.state_drift import Followed

HEALTHY = np.ones(5, dtype=bool)


def followed(drawn: workload.Workload, model: mujoco.MjModel) -> Followed:
    """Return what a target does whose model is another one."""
    own = dataclasses.replace(drawn, model=model)
    return state_drift.follow(own, state_drift.probe(drawn))


def test_points_are_spread_from_the_start_to_the_end() -> None:
    assert state_drift.points(100) == [0, 25, 50, 75, 100]
    assert state_drift.points(1) == [0, 1]


def test_the_same_target_does_not_drift(small: workload.Workload) -> None:
    same = followed(small, small.model)
    drift = state_drift.drift(same, same, HEALTHY)
    assert drift.one_step == 0.0
    assert [run.step for run in drift.runs] == state_drift.points(small.nstep)[1:]
    assert {run.difference for run in drift.runs} == {0.0}


def test_what_changes_late_in_a_run_is_noticed_by_the_steps_there() -> None:
    model, other = (models.load(models.resolve("cartpole")) for _ in range(2))
    drawn = workload.make(model, nbatch=2, nstep=100, spread=0.0)
    end = state_drift.probe(drawn)["qpos"].reshape(5, 2, 2)[-1, 0, 1]
    # a limit that the falling pole reaches only later
    other.jnt_limited[1], other.jnt_range[1] = True, sorted((-abs(end) * 0.9, abs(end) * 0.9))
    baseline, candidate = followed(drawn, model), followed(drawn, other)
    np.testing.assert_array_equal(baseline.stepped["qvel"][0], candidate.stepped["qvel"][0])
    drift = state_drift.drift(baseline, candidate, HEALTHY)
    assert drift.one_step > changed_work.ROUNDING
    assert drift.runs[0].difference == 0.0
    assert drift.runs[-1].difference > changed_work.ROUNDING


def test_differences_are_relative_to_their_field() -> None:
    run = {"qpos": np.full((1, 1, 1), 1e3), "qvel": np.zeros((1, 1, 1))}
    for field, error, expected in (("qpos", 1e-6, 1e-9), ("qvel", 1e-9, 1e-6)):
        stepped = {**run, field: run[field] + error}
        drift = state_drift.drift(Followed([0], run, run), Followed([0], run, stepped), HEALTHY)
        assert drift.one_step == pytest.approx(expected, rel=1e-3)


def test_simulations_that_diverge_are_left_out() -> None:
    run = {"qpos": np.zeros((2, 2, 3))}
    stepped = {"qpos": np.zeros((2, 2, 3))}
    stepped["qpos"][:, 1] = np.nan
    compared = state_drift.drift(
        Followed([0, 5], run, run), Followed([0, 5], stepped, stepped), np.array([True, False])
    )
    assert compared.one_step == 0.0
    assert compared.runs[0].difference == 0.0


def test_models_of_another_size_cannot_be_compared() -> None:
    run, wider = {"qpos": np.zeros((1, 1, 2))}, {"qpos": np.zeros((1, 1, 3))}
    assert state_drift.drift(Followed([0], run, run), Followed([0], wider, wider), HEALTHY) is None
