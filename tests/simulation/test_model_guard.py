"""A change of a model that paths share is noticed, and named."""

from pathlib import Path

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


def test_where_the_files_of_a_model_are_can_be_left_out(tmp_path: Path) -> None:
    xml = CONTACT_XML.replace("<worldbody>", '<asset><mesh file="m.obj"/></asset><worldbody>')
    loaded = []
    for folder in (tmp_path / "one", tmp_path / "another"):
        folder.mkdir()
        (folder / "m.obj").write_text(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        )
        (folder / "model.xml").write_text(xml)
        loaded.append(mujoco.MjModel.from_xml_path(str(folder / "model.xml")))
    guard, other = ModelGuard(loaded[0]), loaded[1]
    assert guard.difference(other) == "npaths"
    assert guard.difference_apart_from_paths(other) is None
    other.opt.timestep = 1
    assert guard.difference_apart_from_paths(other) == "opt.timestep"


@pytest.mark.parametrize("option", ["timestep", "iterations", "disableflags"])
def test_an_option_that_changed_is_named(model: mujoco.MjModel, option: str) -> None:
    guard = ModelGuard(model)
    setattr(model.opt, option, 3)
    assert guard.change() == f"opt.{option}"
