"""What no timer of the engine is about is timed by calling it: sensors by type, and other parts."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
import pytest

from mjbench.commands.profile import step_parts
from mjbench.commands.profile.step_parts import SensorStage, Stage, StepPart
from mjbench.simulation import workload

XML = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 .1"><freejoint/><geom size=".1"/><site name="s" pos="0 0 .2"/></body>
  </worldbody>
  <sensor><gyro site="s"/><rangefinder site="s"/><rangefinder site="s"/><touch site="s"/></sensor>
</mujoco>"""

Contenders = Sequence[tuple[Callable[[], None], step_parts.Function]]


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def timed_by(monkeypatch: pytest.MonkeyPatch, seconds: Callable[[mujoco.MjModel], float]) -> None:
    """Let a call take what a function says of the model, once it was prepared."""

    def medians(
        model: mujoco.MjModel, start: object, contenders: Contenders, budget_s: float
    ) -> list[float]:
        times = []
        for prepare, _ in contenders:
            prepare()
            times.append(seconds(model))
        return times

    monkeypatch.setattr(step_parts, "medians", medians)


def test_sensors_cost_what_their_function_takes_with_them(
    model: mujoco.MjModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def seconds(model: mujoco.MjModel) -> float:
        return 1e-6 + 2e-6 * float((np.asarray(model.sensor_needstage) > 0).sum())

    timed_by(monkeypatch, seconds)
    before = np.array(model.sensor_needstage)
    costs = step_parts.sensor_costs(model, workload.reset_to_start, step_s=1e-5)
    by_type = {cost.type: (cost.stage, cost.count, round(cost.share, 9)) for cost in costs}
    assert by_type == {
        "rangefinder": (SensorStage.POSITION, 2, 0.4),
        "gyro": (SensorStage.VELOCITY, 1, 0.2),
        "touch": (SensorStage.ACCELERATION, 1, 0.2),
    }
    assert costs[0].type == "rangefinder", "the largest comes first"
    np.testing.assert_array_equal(model.sensor_needstage, before)


def test_what_types_share_is_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    xml = XML.replace("</sensor>", '<accelerometer site="s"/></sensor>')
    model = mujoco.MjModel.from_xml_string(xml)
    timed_by(monkeypatch, lambda model: 4e-6 if np.any(model.sensor_needstage) else 1e-6)
    costs = step_parts.sensor_costs(model, workload.reset_to_start, step_s=1e-5)
    of_acceleration = [each for each in costs if each.stage == SensorStage.ACCELERATION]
    assert {each.type: round(each.share, 9) for each in of_acceleration} == {
        "touch": 0.15,
        "accelerometer": 0.15,
    }


def test_each_call_computes_again_what_sensors_share() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    if not hasattr(data, "flg_subtreevel"):
        pytest.skip("this release has no flags")
    data.flg_subtreevel = data.flg_rnepost = 1
    seen = []

    def function(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        seen.append((int(data.flg_subtreevel), int(data.flg_rnepost)))

    step_parts._afresh(function)(model, data)
    assert seen == [(0, 0)]


def test_without_sensors_or_with_sensors_disabled_there_is_no_cost(model: mujoco.MjModel) -> None:
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    assert step_parts.sensor_costs(model, workload.reset_to_start, 1e-5) == []


def test_parts_are_taken_from_the_stage_that_they_are_in() -> None:
    stages = {Stage.KINEMATICS: 0.3, Stage.OTHER: 0.7}
    parts = [
        StepPart(Stage.SENSORS, Stage.OTHER, 0.6),
        StepPart(Stage.TENDONS, Stage.KINEMATICS, 0.2),
    ]
    apart = step_parts.with_parts(stages, parts)
    assert apart == pytest.approx({"kinematics": 0.1, "other": 0.1, "sensors": 0.6, "tendons": 0.2})


def test_collision_is_one_stage_among_the_longest_and_what_is_left_is_none() -> None:
    shares = {"broad-phase collision": 0.2, "narrow-phase collision": 0.15, "other": 0.65}
    assert step_parts.longest({**shares, "sensors": 0.3}) == ("collision", pytest.approx(0.35))
    assert step_parts.longest({**shares, "tendons": 0.4}) == ("tendons", 0.4)


def test_a_stage_is_not_left_with_less_than_nothing() -> None:
    parts = [
        StepPart(Stage.SENSORS, Stage.OTHER, 0.6),
        StepPart(Stage.ENERGY, Stage.OTHER, 0.2),
    ]
    apart = step_parts.with_parts({"kinematics": 0.6, "other": 0.4}, parts)
    assert sum(apart.values()) == pytest.approx(1.0)
    assert apart == pytest.approx({"kinematics": 0.6, "other": 0.0, "sensors": 0.3, "energy": 0.1})


TENDON = """
<mujoco>
  <option integrator="RK4"><flag energy="enable"/></option>
  <worldbody><body><joint name="hinge"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
  <tendon><fixed><joint joint="hinge" coef="1"/></fixed></tendon>
</mujoco>"""


def test_tendons_are_a_part_of_kinematics_and_rk4_computes_them_four_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = mujoco.MjModel.from_xml_string(TENDON)
    calls = iter(range(10))
    timed_by(monkeypatch, lambda model: 1e-6 * next(calls))  # the first is an empty call
    parts = step_parts.parts(model, workload.reset_to_start, 1e-4, [])
    shares = [(part.stage, part.within, round(part.share, 9)) for part in parts]
    assert shares == [
        ("smooth acceleration", "other", 0.04),
        ("checks of the state", "other", 0.02),
        ("checks of the state", "other", 0.03),
        ("checks of the state", "other", 0.04),
        ("energy", "other", 0.05),
        ("energy", "other", 0.06),
        ("tendons", "kinematics", 0.28),
    ]


def test_the_parts_of_a_step_leave_the_model_as_it_was(model: mujoco.MjModel) -> None:
    before = np.array(model.sensor_needstage)
    costs = step_parts.sensor_costs(model, workload.reset_to_start, 1e-5, budget_s=0.0)
    parts = step_parts.parts(model, workload.reset_to_start, 1e-5, costs, budget_s=0.0)
    assert {part.stage for part in parts} >= {"sensors", "smooth acceleration"}
    assert all(part.share >= 0 for part in parts)
    np.testing.assert_array_equal(model.sensor_needstage, before)
