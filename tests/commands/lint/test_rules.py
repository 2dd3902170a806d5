"""A viewer that is synced in every step."""

import pytest
from linted import findings

SETUP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
with mujoco.viewer.launch_passive(model, data) as viewer:
    while viewer.is_running():
        mujoco.mj_step(model, data)
        {line}
"""


def test_a_viewer_that_is_synced_in_every_step_is_found() -> None:
    (finding,) = findings(SETUP.format(line="viewer.sync()"))
    assert finding.code == "MJB021"


def test_a_viewer_may_be_assigned() -> None:
    text = """
        viewer = mujoco.viewer.launch_passive(model, data)
        for _ in range(steps):
            mujoco.mj_step(model, data)
            viewer.sync()
    """
    assert [each.code for each in findings(text)] == ["MJB021"]


@pytest.mark.parametrize(
    "line",
    [
        "viewer.sync(); time.sleep(model.opt.timestep)",
        "viewer.sync(); rate.sleep()",
        "viewer.sync(); keep_real_time(data)",
        "mujoco.mj_step(model, data); viewer.sync()",
        "if time.perf_counter() > due: viewer.sync()",
        "if data.time > due: viewer.sync()",
        "for _ in range(4): mujoco.mj_step(model, data)\n        viewer.sync()",
        "other.sync()",
    ],
)
def test_a_viewer_that_keeps_a_rate_is_no_finding(line: str) -> None:
    helper = "def keep_real_time(data):\n    time.sleep(data.time - time.monotonic())\n"
    assert findings(helper + SETUP.format(line=line), "MJB021") == []


def test_several_steps_in_a_call_are_no_finding() -> None:
    text = SETUP.format(line="viewer.sync()").replace("mj_step(model, data)", "mj_step(m, data, 9)")
    assert findings(text, "MJB021") == []
