"""What the tests share: a small model that starts in contact, and its workload."""

from typing import Any

import mujoco
import pytest

from mjbench import workload

# A box resting on the floor, a motor-driven arm, and a mocap body away from its default pose.
CONTACT_XML = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="target" mocap="true" pos="0 0 2"/>
    <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 .5">
      <joint name="arm" type="hinge" axis="0 1 0"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .3 0 0"/>
    </body>
  </worldbody>
  <actuator><motor joint="arm" ctrlrange="-1 1" ctrllimited="true"/></actuator>
  <sensor><jointpos joint="arm"/></sensor>
  <keyframe><key qpos="0 0 .098 1 0 0 0 .1" ctrl=".2" mpos="0 0 3"/></keyframe>
</mujoco>
"""


def pytest_configure(config: pytest.Config) -> None:
    """Time nothing unless asked to: `pytest` runs every benchmark once, to see that it works."""
    if not (config.getoption("benchmark_only") or config.getoption("benchmark_enable")):
        config.option.benchmark_disable = True


@pytest.fixture(scope="session")
def model() -> Any:
    return mujoco.MjModel.from_xml_string(CONTACT_XML)


@pytest.fixture
def small(model: Any) -> workload.Workload:
    return workload.make(model, nbatch=5, nstep=12, hold=3, seed=1)


@pytest.fixture
def contact_file(tmp_path: Any) -> str:
    path = tmp_path / "contact.xml"
    path.write_text(CONTACT_XML)
    return str(path)
