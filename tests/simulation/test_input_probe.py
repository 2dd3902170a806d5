"""A workload in which every input counts: what a path drops shows in its states."""

import mujoco
import numpy as np
import pytest

from mjbench.simulation import compat, input_probe, models, reference_run, workload

# A model with every input of mjSTATE_INTEGRATION that MJCF alone can give it.
XML = """
<mujoco>
  <size nuserdata="3"/>
  <worldbody>
    <body name="hand" mocap="true" pos="0 0 1"><geom size=".05"/></body>
    <body name="held" pos="0 0 1"><freejoint/><geom size=".04"/></body>
    <body name="arm" pos="1 0 1"><joint name="elbow" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
    </body>
  </worldbody>
  <equality>
    <weld body1="hand" body2="held"/>
    <joint joint1="elbow" polycoef=".1 0 0 0 0"/>
  </equality>
  <actuator>
    <general joint="elbow" dyntype="filter" dynprm=".1" gainprm="1" actlimited="true"
             actrange="-1 1"/>
  </actuator>
</mujoco>
"""
FIELDS = ("act", "qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat")


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture(scope="module")
def plain(model: mujoco.MjModel) -> workload.Workload:
    return workload.make(model, nbatch=4, nstep=10)


def columns(model: mujoco.MjModel) -> dict[str, slice]:
    return compat.state_columns(model)


@pytest.mark.parametrize("field", [*FIELDS, "userdata"])
def test_an_input_differs_from_simulation_to_simulation(
    model: mujoco.MjModel, plain: workload.Workload, field: str
) -> None:
    place = columns(model)[field]
    values = input_probe.with_every_input(plain, seed=0).initial_state[:, place]
    assert (values[1:] != values[:-1]).any(axis=1).all()
    assert (values[0] != values[-1]).any()
    assert (values != plain.initial_state[:, place]).any(axis=1).all()


def test_a_single_equality_is_active_in_every_second_simulation() -> None:
    gripper = models.load(models.resolve("gripper"))
    every = input_probe.with_every_input(workload.make(gripper, nbatch=4, nstep=2), seed=0)
    place = compat.state_columns(gripper)["eq_active"]
    assert every.initial_state[:, place].ravel().tolist() == [0.0, 1.0, 0.0, 1.0]


@pytest.mark.parametrize("field", FIELDS)
def test_an_input_that_is_dropped_changes_the_final_states(
    model: mujoco.MjModel, plain: workload.Workload, field: str
) -> None:
    every = input_probe.with_every_input(plain, seed=0)
    place = columns(model)[field]
    dropped = every.returning(every.returns)
    dropped.initial_state[:, place] = plain.initial_state[:, place]
    physics = compat.physics_entries(model)
    ends = [reference_run.observe(w).final_state[:, physics] for w in (every, dropped)]
    assert (ends[0] != ends[1]).any()


def test_values_are_possible_and_the_simulations_healthy(
    model: mujoco.MjModel, plain: workload.Workload
) -> None:
    every = input_probe.with_every_input(plain, seed=0)
    state = {name: every.initial_state[:, place] for name, place in columns(model).items()}
    assert np.abs(state["act"]).max() <= 1.0
    assert set(np.unique(state["eq_active"])) <= {0.0, 1.0}
    np.testing.assert_allclose(np.linalg.norm(state["mocap_quat"], axis=1), 1.0)
    assert reference_run.observe(every).healthy.all()


def test_only_the_named_fields_are_set(model: mujoco.MjModel, plain: workload.Workload) -> None:
    states = input_probe.set_inputs(model, plain.initial_state, seed=0, fields=["qfrc_applied"])
    changed = (states != plain.initial_state).any(axis=0)
    expected = np.zeros_like(changed)
    expected[columns(model)["qfrc_applied"]] = True
    np.testing.assert_array_equal(changed, expected)


def test_the_workload_itself_stays_as_it_is(plain: workload.Workload) -> None:
    before = plain.digest()
    input_probe.with_every_input(plain, seed=0)
    assert plain.digest() == before
