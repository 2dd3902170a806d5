"""A digest names what decides the cost of a step."""

from pathlib import Path

import mujoco
import pytest

from mjbench.simulation import models
from mjbench.simulation.model_digest import model_digest

XML = (
    "<mujoco model='{name}'><option timestep='{timestep}'/><worldbody><body name='{name}'>"
    "<freejoint/><geom size='.1' rgba='{red} 0 0 1'/></body></worldbody></mujoco>"
)


def digest(name: str = "a", timestep: float = 0.002, red: float = 1) -> str:
    xml = XML.format(name=name, timestep=timestep, red=red)
    return model_digest(mujoco.MjModel.from_xml_string(xml))


def test_neither_names_nor_colours_count() -> None:
    assert digest() == digest(name="b") == digest(red=0.5)


def test_options_count() -> None:
    assert digest() != digest(timestep=0.001)
    model = mujoco.MjModel.from_xml_string(XML.format(name="a", timestep=0.002, red=1))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    assert model_digest(model) != digest()


@pytest.mark.parametrize("name", ["cartpole", "muscle_arm"])
def test_a_saved_model_has_the_digest_of_its_source(name: str, tmp_path: Path) -> None:
    model = models.load(models.resolve(name))
    file = tmp_path / "renamed.mjb"
    mujoco.mj_saveModel(model, str(file), None)
    assert model_digest(models.load(models.ModelSource("", file))) == model_digest(model)
