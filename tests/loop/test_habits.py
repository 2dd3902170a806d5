"""The table of habits: names, cheaper forms, and what a model must have."""

import mujoco

from mjbench.loop import habits
from mjbench.simulation import models


def available(model: mujoco.MjModel) -> set[str]:
    return {habit.name for habit in habits.HABITS if habit.requires(model, "")}


def test_names_are_unique_and_cheaper_forms_exist() -> None:
    names = [habit.name for habit in habits.HABITS]
    assert len(names) == len(set(names))
    assert {habit.cheaper for habit in habits.HABITS if habit.cheaper} <= set(names)


def test_a_model_whose_joints_have_no_names_has_no_access_by_name() -> None:
    names = available(models.load(models.resolve("pile")))
    assert "named access by name" not in names
    assert "named access by id" in names


def test_a_model_without_actuators_has_no_controls_to_write() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    assert not any(name.startswith("control") for name in available(model))
    assert any(
        name.startswith("control") for name in available(models.load(models.resolve("cartpole")))
    )
