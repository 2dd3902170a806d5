"""The distance below which a contact acts, as this release computes it."""

import mujoco
import pytest

from mjbench.simulation import compat


@pytest.mark.parametrize("pair", ["", "<pair geom1='floor' geom2='ball' margin='.3' gap='.05'/>"])
@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_the_margin_of_two_geoms_is_that_of_their_contact(pair: str, gap: float) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><geom name='floor' type='plane' size='1 1 1' margin='.1' gap='{gap}'/>"
        "<body><freejoint/><geom name='ball' size='.1' margin='.2' gap='.02'/></body></worldbody>"
        f"<contact>{pair}</contact></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    contact = data.contact[0]
    assert compat.include_margin(model, *contact.geom) == pytest.approx(contact.includemargin)
