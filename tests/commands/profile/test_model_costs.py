"""What collisions cost is told by types and pairs of geoms, with cells and vertices."""

import mujoco
import numpy as np
import pytest
from example_models import COSTS_XML, initial_states

from mjbench.commands.profile import model_costs, step_parts
from mjbench.commands.profile.model_costs import Cost, CostKind
from mjbench.commands.profile.step_parts import SensorCost, SensorStage, Stage, StepStages


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(COSTS_XML)


@pytest.fixture
def states(model):
    return initial_states(model, 2)


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
    costs = {cost.name: cost for cost in model_costs._pairs(model, states, 0.9, 1e-5)}
    # a pair of boxes adds 6 µs; two of a box and the floor, and one of a sphere, 1 µs each
    assert costs["box “a” and box “b”"].share == pytest.approx(0.9 * 6 / 9)
    assert costs["box and plane"] == Cost(
        CostKind.TYPES, "box and plane", 2, pytest.approx(0.9 * 2 / 9)
    )
    np.testing.assert_array_equal((model.geom_contype, model.geom_conaffinity), before)


def test_only_geoms_that_come_near_are_timed(model, states):
    pairs = np.array([[1, 2], [1, 3], [0, 3]])
    nearness = model_costs._nearness(model, states, pairs)
    assert nearness.tolist() == [
        model_costs.Nearness.TOUCHING,
        model_costs.Nearness.FAR,
        model_costs.Nearness.TOUCHING,
    ]


TERRAIN = """
<mujoco>
  <asset>
    <hfield name="hills" nrow="21" ncol="41" size="2 2 .1 .1"/>
    <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1  .02 .02 .02"/>
  </asset>
  <worldbody>
    <geom type="hfield" hfield="hills"/>
    <body pos="0 0 .1"><freejoint/><geom size=".2"/></body>
    <body pos="1 0 .1"><freejoint/><geom size=".2"/></body>
    <body pos="-1 0 .05"><freejoint/><geom type="mesh" mesh="wedge"/></body>
  </worldbody>
</mujoco>"""


def test_a_height_field_is_named_with_its_cells_and_a_mesh_with_its_vertices(monkeypatch):
    model = mujoco.MjModel.from_xml_string(TERRAIN)
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    states = np.empty((1, mujoco.mj_stateSize(model, spec)))
    mujoco.mj_getState(model, mujoco.MjData(model), states[0], spec)
    monkeypatch.setattr(model_costs, "_weights", lambda *_: {(0, 1): 2e-6, (0, 2): 2e-6, (0, 3): 0})
    costs = model_costs.collision_costs(model, states, {"narrow-phase collision": 0.8}, 1e-5)
    assert str(costs[0]) == ("hfield and sphere (2): 80 %; height field “hills” has 20 × 40 cells")
    assert model_costs._finest(model, [3, 1]) == (
        "mesh “wedge” has 5 vertices, 4 of them on its hull"
    )


def test_sensors_that_cost_are_told_how_to_be_computed_less_often():
    world = "<worldbody><site name='eye'/></worldbody><sensor><rangefinder site='eye' {}/></sensor>"
    cost = SensorCost("rangefinder", SensorStage.POSITION, 1, 0.6)

    def said(attributes, stage_share=0.7):
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{world.format(attributes)}</mujoco>")
        step = StepStages(1e-5, {Stage.SENSORS: stage_share}, [cost])
        return [str(each) for each in model_costs.sensor_costs(model, step)]

    assert said("") == [
        'rangefinder (1): 60 %; with interval="0.1" nsample="1", a sensor is computed each 0.1 s;'
        " interval alone skips no step"
    ]
    assert said("interval='0.1' nsample='1'") == ["rangefinder (1): 60 %"]
    assert said("interval='0.1' nsample='1'", 0.5) == ["rangefinder (1): 50 %"]


def test_a_small_narrow_phase_is_not_divided():
    assert model_costs.collision_costs(None, None, {"narrow-phase collision": 0.01}, 1e-5) == []


def test_what_costs_most_is_of_the_longest_stage():
    sensors = Cost(CostKind.SENSORS, "rangefinder", 4, 0.4)
    pair = Cost(CostKind.PAIR, "box and box", 1, 0.1)
    stages = {"narrow-phase collision": 0.35, "other": 0.65}
    assert model_costs.main_cost(stages, [sensors, pair]) == pair
    assert model_costs.main_cost({**stages, "sensors": 0.4}, [sensors, pair]) == sensors
    assert model_costs.main_cost({"tendons": 1.0}, [sensors, pair]) is None


@pytest.mark.parametrize(
    ("world", "option", "count"),
    [
        (3 * "<geom size='.1'/>", "", 3),
        (3 * "<geom size='.1'/>", "<option><flag sleep='enable'/></option>", 0),
        ("<geom size='.1'/>", "", 0),
    ],
)
def test_static_geoms_count_where_they_are_most_and_do_not_sleep(world, option, count):
    moving = "<body><freejoint/><geom size='.1'/><body><geom size='.1'/></body></body>"
    xml = f"<mujoco>{option}<worldbody>{world}{moving}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    costs = model_costs.static_costs(model, {Stage.KINEMATICS: 0.5})
    assert sum(cost.count for cost in costs) == count
