"""What mjbench suggests computes the same as what the program does."""

import mujoco
import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.program import trials
from mjbench.program.trials import Question, Trial

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
