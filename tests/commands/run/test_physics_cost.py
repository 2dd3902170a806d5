"""What costs in a step is told by its stage, its pairs of geoms and its sensors."""

import mujoco
import numpy as np
import pytest

from mjbench.commands.profile import step_parts
from mjbench.commands.run import physics_cost
from mjbench.commands.run.physics_cost import Cost, CostKind, PhysicsCost
from mjbench.commands.run.recorded_models import RecordedModel

XML = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body pos="0 0 .1"><freejoint/><geom name="a" type="box" size=".1 .1 .1"/></body>
    <body pos=".15 0 .25"><freejoint/><geom name="b" type="box" size=".1 .1 .1"/></body>
    <body pos="3 0 .1"><freejoint/><geom name="c" size=".1"/><site name="s"/></body>
  </worldbody>
  <sensor><gyro site="s"/><rangefinder site="s"/><rangefinder site="s"/></sensor>
</mujoco>"""


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture
def states(model):
    data = mujoco.MjData(model)
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    rows = np.empty((2, mujoco.mj_stateSize(model, spec)))
    for row in rows:
        mujoco.mj_getState(model, data, row, spec)
    return rows


def time_by(monkeypatch, seconds):
    """Let a call take what a function says of the model, once it was prepared."""

    def medians(model, start, contenders, budget_s):
        times = []
        for prepare, _ in contenders:
            contenders[0][0]()
            prepare()
            times.append(seconds(model))
        return times

    monkeypatch.setattr(step_parts, "medians", medians)


def test_pairs_share_the_narrow_phase_by_what_each_adds_to_collision(model, states, monkeypatch):
    boxes = [model.geom("a").id, model.geom("b").id]

    def seconds(model):
        enabled = set(np.flatnonzero(model.geom_contype))
        return 7e-6 if enabled == set(boxes) else 2e-6 if 0 in enabled else 1e-6

    time_by(monkeypatch, seconds)
    before = np.array(model.geom_contype), np.array(model.geom_conaffinity)
    costs = {cost.name: cost for cost in physics_cost._pairs(model, states, 0.9, 1e-5)}
    # a pair of boxes adds 6 µs; two of a box and the floor, and one of a sphere, 1 µs each
    assert costs["box “a” and box “b”"].share == pytest.approx(0.9 * 6 / 9)
    assert costs["box and plane"] == Cost(
        CostKind.TYPES, "box and plane", 2, pytest.approx(0.9 * 2 / 9)
    )
    np.testing.assert_array_equal((model.geom_contype, model.geom_conaffinity), before)


def test_only_geoms_that_come_near_are_timed(model, states):
    pairs = np.array([[1, 2], [1, 3], [0, 3]])
    nearness = physics_cost._nearness(model, states, pairs)
    assert nearness.tolist() == [
        physics_cost.Nearness.TOUCHING,
        physics_cost.Nearness.FAR,
        physics_cost.Nearness.TOUCHING,
    ]


def test_the_programs_model_is_measured_in_a_child(model, states, tmp_path):
    file = tmp_path / "model.mjb"
    mujoco.mj_saveModel(model, str(file))
    recorded = RecordedModel(file.read_bytes(), states, states[:0], mujoco.__version__)
    cost = physics_cost.measure([recorded], {})
    assert cost.step_ns > 0
    assert sum(cost.stages.values()) == pytest.approx(1.0)


def test_a_model_of_another_release_is_not_measured(states):
    assert physics_cost.measure([RecordedModel(b"", states, states[:0], "2.0")], {}) is None


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
