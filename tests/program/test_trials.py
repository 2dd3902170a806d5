"""What mjbench suggests computes the same as what the program does."""

import mujoco
import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.program import trials
from mjbench.program.trials import Question, Trial
from mjbench.simulation import compat

FALLING = """
<mujoco>
  <option integrator="{}"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .2"><freejoint/><geom size=".1"/></body>
    <body pos="0 0 .6"><joint axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
</mujoco>
"""


def model(integrator="Euler"):
    return mujoco.MjModel.from_xml_string(FALLING.format(integrator))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_inverse_dynamics_within_a_step_leaves_the_same_state(integrator):
    states = []
    for way in trials.ways(model(integrator), Question(Trial.INVERSE)):
        data = mujoco.MjData(model(integrator))
        for _ in range(200):
            way.run(data)
        states.append([*data.qpos, *data.qvel, *data.qacc_warmstart])
    assert states[0] == states[1]


def test_halves_of_a_step_are_not_suggested_for_runge_kutta():
    with pytest.raises(InputError, match="Euler"):
        trials.ways(model("RK4"), Question(Trial.INVERSE))


def test_contacts_one_by_one_and_as_arrays_are_the_same():
    data = mujoco.MjData(model())
    mujoco.mj_step(model(), data, 200)
    one_by_one, arrays = trials.ways(model(), Question(Trial.CONTACTS))
    assert data.ncon
    assert np.array_equal(one_by_one.run(data), arrays.run(data))


@pytest.mark.parametrize("trial", [trial for trial in Trial if trial != Trial.RENDERER])
def test_both_ways_of_each_trial_run(trial):
    functions = ("mj_kinematics",) if trial == Trial.FUNCTIONS else ()
    for way in trials.ways(model(), Question(trial, functions, simulations=2)):
        way.run(mujoco.MjData(model()))


def test_a_mistake_in_a_trial_is_no_lack_of_a_release():
    """A TypeError ends the child of `replacements`, which says so."""
    assert not issubclass(TypeError, trials.LACKING)


def test_rays_at_once_hit_what_single_rays_hit():
    data = mujoco.MjData(model())
    mujoco.mj_forward(model(), data)
    vectors, geom = np.array([[0.0, 0, -1], [0, 0, 1], [1, 0, -0.1]]), np.empty(1, np.int32)
    origin, geoms, distances = np.array([0.0, 0, 1]), np.empty(3, np.int32), np.empty(3)
    compat.cast_rays(model(), data, origin, vectors, geoms, distances)
    single = [mujoco.mj_ray(model(), data, origin, each, None, 1, -1, geom) for each in vectors]
    assert distances.tolist() == single


def test_a_step_with_controls_is_that_of_a_rollout():
    actuated = mujoco.MjModel.from_xml_string(
        FALLING.format("Euler")
        .replace(
            "</worldbody>",
            "</worldbody><actuator><motor joint='hinge'/></actuator>",
        )
        .replace("<joint axis", '<joint name="hinge" axis')
    )
    ends = []
    for way in trials.ways(actuated, Question(Trial.NO_ROLLOUT)):
        data = mujoco.MjData(actuated)
        way.prepare(data)
        for _ in range(3):
            way.run(data)
        ends.append([*data.qpos, *data.ctrl])
    assert ends[0] == ends[1]
