"""What costs in a step is told by its stage, its pairs of geoms and its sensors."""

import mujoco
import numpy as np
import pytest
from example_models import COSTS_XML, initial_states

from mjbench.commands.profile.model_costs import Cost, CostKind
from mjbench.commands.run import physics_cost
from mjbench.commands.run.physics_cost import PhysicsCost
from mjbench.commands.run.recorded_models import RecordedModel


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(COSTS_XML)


@pytest.fixture
def states(model):
    return initial_states(model, 2)


def test_the_programs_model_is_measured_in_a_child(model, states, tmp_path):
    file = tmp_path / "model.mjb"
    mujoco.mj_saveModel(model, str(file))
    recorded = RecordedModel(file.read_bytes(), states, states[:0], mujoco.__version__)
    cost = physics_cost.measure([recorded], {})
    assert cost.step_ns > 0
    assert sum(cost.stages.values()) == pytest.approx(1.0)


def test_a_model_of_another_release_is_not_measured(states):
    assert physics_cost.measure([RecordedModel(b"", states, states[:0], "2.0")], {}) is None


def saved(model):
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def test_sensors_are_taken_from_what_the_engines_timers_leave(model, states, tmp_path, inline):
    file = tmp_path / "model.mjb"
    mujoco.mj_saveModel(model, str(file))
    recorded = RecordedModel(file.read_bytes(), states, states[:0], mujoco.__version__)
    of_program = {"kinematics": 0.25, "narrow-phase collision": 0.0, "other": 0.75}
    cost = physics_cost.measure([recorded], of_program)
    assert cost.stages["kinematics"] == 0.25
    assert sum(cost.stages.values()) == pytest.approx(1.0)
    assert cost.stages["sensors"] > 0
    assert cost.stages["other"] < 0.75


def test_collision_is_one_stage_and_what_is_left_is_none():
    sensors = Cost(CostKind.SENSORS, "rangefinder", 4, 0.4)
    pair = Cost(CostKind.PAIR, "box and box", 1, 0.1)
    stages = {"broad-phase collision": 0.2, "narrow-phase collision": 0.15, "other": 0.5}
    with_sensors = PhysicsCost(1.0, {**stages, "sensors": 0.4, "other": 0.1}, [sensors, pair])
    assert with_sensors.main_stage == ("sensors", 0.4)
    assert with_sensors.main_cost == sensors
    without = PhysicsCost(1.0, stages, [pair])
    assert without.main_stage == ("collision", pytest.approx(0.35))
    assert without.main_cost == pair


def test_the_integrator_and_the_timestep_are_named_where_they_cost(model, states, inline):
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 0.0005
    recorded = RecordedModel(saved(model), states, states[:0], mujoco.__version__)
    cost = physics_cost.measure([recorded], {"kinematics": 1.0, "narrow-phase collision": 0.0})
    assert cost.evaluations.sentence.startswith("RK4 at 0.5 ms evaluates the dynamics 8,000 times")
