"""What the tests of paired comparison share: a model that diverges."""

from pathlib import Path

import pytest
from paired_examples import INSTALLED

from mjbench.paired.targets import Target
from mjbench.simulation import models


@pytest.fixture
def stiff(tmp_path: Path) -> Target:
    """Return a spring that a timestep of 2.5 ms blows up, by about four in each step."""
    file = tmp_path / "stiff.xml"
    file.write_text(
        "<mujoco><option timestep='1e-4' integrator='Euler'/><worldbody><body>"
        "<joint type='slide' stiffness='1e5'/><geom size='.1' mass='.1'/></body>"
        "</worldbody></mujoco>"
    )
    return Target(INSTALLED, models.resolve(str(file)))
