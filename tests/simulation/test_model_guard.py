"""A change of a model that paths share is noticed, and named."""

import mujoco
import pytest
from example_models import CONTACT_XML

from mjbench.simulation.model_guard import ModelGuard


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(CONTACT_XML)


def test_stepping_changes_nothing(model: mujoco.MjModel) -> None:
    guard = ModelGuard(model)
    mujoco.mj_step(model, mujoco.MjData(model), 5)
    assert guard.change() is None


def test_the_field_that_changed_is_named(model: mujoco.MjModel) -> None:
    guard = ModelGuard(model)
    model.body_mass[-1] *= 1.01
    assert guard.change() == "body_mass"
    model.body_mass[-1] /= 1.01


@pytest.mark.parametrize("option", ["timestep", "iterations", "disableflags"])
def test_an_option_that_changed_is_named(model: mujoco.MjModel, option: str) -> None:
    guard = ModelGuard(model)
    setattr(model.opt, option, 3)
    assert guard.change() == f"opt.{option}"
