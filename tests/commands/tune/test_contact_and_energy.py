"""What a model says of states: penetration, violations, energy and contact forces."""

import mujoco
import numpy as np
import pytest

from mjbench.commands.tune.contact_and_energy import physics
from mjbench.simulation import compat

BOX = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
    <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="2"/></body>
    </worldbody></mujoco>"""
)
LIMITED = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body><joint type="slide" limited="true" range="-1 1"/>
    <geom size="0.1"/></body></worldbody></mujoco>"""
)


def state_of(model, qpos, qvel=None, nstep=0):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    if qvel is not None:
        data.qvel[:] = qvel
    mujoco.mj_step(model, data, nstep)
    spec = compat.INTEGRATION
    row = np.empty(compat.state_size(model, spec))
    compat.get_state(model, data, row, spec)
    return row


def test_a_box_at_rest_presses_with_its_weight():
    rest = state_of(BOX, [0, 0, 0.1, 1, 0, 0, 0], nstep=2000)
    of_rest = physics(BOX, rest[None], rest[None, None])
    assert of_rest.contact_force_n == pytest.approx(2 * 9.81, rel=1e-3)
    assert 0 < of_rest.penetration_m < 1e-2
    assert of_rest.energy_drift_j == 0.0
    assert of_rest.violation == 0.0


def test_penetration_is_that_of_the_deepest_contact_averaged_over_states():
    shallow = state_of(BOX, [0, 0, 0.09, 1, 0, 0, 0])
    deep = state_of(BOX, [0, 0, 0.07, 1, 0, 0, 0])
    of_both = physics(BOX, shallow[None], np.array([[shallow, deep]]))
    assert of_both.penetration_m == pytest.approx(0.02, abs=1e-6)


def test_energy_is_counted_from_the_start():
    rest = state_of(BOX, [0, 0, 1.0, 1, 0, 0, 0])
    lifted = state_of(BOX, [0, 0, 1.5, 1, 0, 0, 0], qvel=[1, 0, 0, 0, 0, 0])
    of_lift = physics(BOX, rest[None], lifted[None, None])
    assert of_lift.energy_drift_j == pytest.approx(2 * 9.81 * 0.5 + 0.5 * 2)
    assert of_lift.contact_force_n == 0.0


def test_a_limit_is_violated_by_how_far_it_is_exceeded():
    within, beyond = (state_of(LIMITED, [q]) for q in (0.5, 1.2))
    assert physics(LIMITED, within[None], within[None, None]).violation == 0.0
    assert physics(LIMITED, within[None], beyond[None, None]).violation == pytest.approx(0.2)


def test_an_equality_is_violated_on_both_sides():
    welded = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="a" type="slide"/><geom size="0.1"/></body>
        </worldbody><equality><joint joint1="a" polycoef="0 0 0 0 0"/></equality></mujoco>"""
    )
    below = state_of(welded, [-0.3])
    assert physics(welded, below[None], below[None, None]).violation == pytest.approx(0.3)
