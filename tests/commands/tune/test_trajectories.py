"""Runs are those of a plain loop, whatever the timestep, and end where they diverge."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjbench.commands.tune import trajectories
from mjbench.commands.tune.trajectories import SensorChange, Trials
from mjbench.errors import InputError
from mjbench.simulation import models, workload

HOLD = 8


def trials_of(model, nbatch=3, ncontrol=5, seed=0):
    drawn = workload.make(model, nbatch, ncontrol * HOLD, HOLD, seed)
    return Trials(drawn.initial_state, drawn.control, HOLD * model.opt.timestep)


@pytest.fixture(scope="module")
def cartpole():
    return models.load(models.resolve("cartpole"))


def test_runs_are_those_of_a_plain_loop(cartpole):
    trials = trials_of(cartpole)
    runs = trajectories.run(cartpole, trials, nthread=2)
    data = mujoco.MjData(cartpole)
    for row in range(trials.nrun):
        mujoco.mj_resetData(cartpole, data)
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        mujoco.mj_setState(cartpole, data, trials.initial_state[row], spec)
        for k, control in enumerate(trials.control[row]):
            data.ctrl[:] = control
            for _ in range(HOLD):
                mujoco.mj_step(cartpole, data)
            np.testing.assert_array_equal(runs.qpos[row, k], data.qpos)
            np.testing.assert_array_equal(runs.qvel[row, k], data.qvel)
    assert not runs.diverged.any()
    assert np.isfinite(runs.points).all()


def test_a_larger_timestep_takes_fewer_steps_in_the_same_time(cartpole):
    trials = trials_of(cartpole)
    assert trajectories.steps_per_control(cartpole, trials.control_s) == HOLD
    coarse = models.load(models.resolve("cartpole"))
    coarse.opt.timestep *= 4
    assert trajectories.steps_per_control(coarse, trials.control_s) == HOLD // 4
    fine, rough = trajectories.run(cartpole, trials), trajectories.run(coarse, trials)
    assert not fine.is_identical(rough)
    np.testing.assert_allclose(fine.qpos, rough.qpos, atol=0.05)


@pytest.mark.parametrize("factor", [3.0, 16.0, 1.5])
def test_a_timestep_that_does_not_divide_a_control_is_refused(cartpole, factor):
    trials = trials_of(cartpole)
    other = models.load(models.resolve("cartpole"))
    other.opt.timestep *= factor
    with pytest.raises(InputError, match="does not divide"):
        trajectories.run(other, trials)


def test_a_model_with_another_state_is_refused(cartpole):
    trials = trials_of(cartpole)
    with pytest.raises(InputError, match="size"):
        trajectories.run(models.load(models.resolve("humanoid")), trials)


def test_a_model_with_fewer_bodies_runs_from_the_same_starts():
    xml = (
        "<mujoco><compiler fusestatic='{}'/><worldbody><body><joint axis='0 1 0'/>"
        "<geom size='.1' pos='.2 0 0'/><body pos='.3 0 0'><geom size='.1'/></body></body>"
        "</worldbody></mujoco>"
    )
    whole, fused = (mujoco.MjModel.from_xml_string(xml.format(text)) for text in ("false", "true"))
    assert fused.nbody < whole.nbody
    trials = trials_of(whole)
    runs = trajectories.run(fused, trials)
    np.testing.assert_allclose(runs.qpos, trajectories.run(whole, trials).qpos, rtol=1e-9)
    trials.initial_state[0, -1] = 1.0  # a force on a body that may have gone
    with pytest.raises(InputError, match="size"):
        trajectories.run(fused, trials)


def test_one_bit_is_a_difference(cartpole):
    trials = trials_of(cartpole)
    runs, others = (trajectories.run(cartpole, trials) for _ in range(2))
    assert runs.is_identical(others)
    others.qvel[1, 2, 0] = np.nextafter(others.qvel[1, 2, 0], 9.0)
    assert not runs.is_identical(others)


def test_runs_that_diverge_are_marked():
    model = models.load(models.resolve("cartpole"))
    trials = trials_of(model)
    trials.initial_state[1, 1 : 1 + model.nq] = 1e12
    runs = trajectories.run(model, trials)
    assert runs.diverged.tolist() == [False, True, False]


def test_points_end_with_the_run():
    assert trajectories.points(62) == [16, 31, 46, 62]
    assert trajectories.points(1) == [1, 1, 1, 1]


def test_sensors_differ_by_shares_of_their_largest_values():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="joint"/><geom size="0.1"/><site name="at"/></body>
        </worldbody>
        <sensor><jointpos joint="joint"/><framepos objtype="site" objname="at"/>
        <jointvel joint="joint"/></sensor></mujoco>"""
    )
    shape = (2, trajectories.NPOINT, model.nsensordata)
    runs = trajectories.run(model, trials_of(model, nbatch=2))
    runs.sensordata[:] = np.broadcast_to([2.0, 0.0, 1.0, 4.0, 0.0], shape)
    others = replace(runs, sensordata=runs.sensordata.copy())
    assert trajectories.sensor_change(model, runs, others) == SensorChange(0, 0.0)
    runs.sensordata[1, 2] = [2.01, 0.0, 1.0, 4.008, 0.0]
    change = trajectories.sensor_change(model, runs, others)
    assert change.changed == 0 and change.share == pytest.approx(0.005)
    runs.sensordata[0, 0] = [3.0, 0.0, 1.0, 4.008, 1e-9]  # the last one was always 0
    change = trajectories.sensor_change(model, runs, others)
    assert change.changed == 2 and change.share == pytest.approx(0.002)
