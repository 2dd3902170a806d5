"""mj_forward after mj_step: what is enough in its place, by the engine and by lint."""

from collections.abc import Sequence

import mujoco
import numpy as np
import pytest
from commands import ROOT
from linted import findings

from mjbench.commands.lint.forward import COMPUTED, STATE

LOOP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(9):
    {before}
    mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    {line}
"""
NEEDED: dict[str, Sequence[str]] = {
    "mj_kinematics": ("mj_kinematics",),
    "mj_comPos": ("mj_kinematics", "mj_comPos"),
    "mj_camlight": ("mj_kinematics", "mj_comPos", "mj_camlight"),
    "mj_tendon": ("mj_kinematics", "mj_comPos", "mj_tendon"),
}
JACOBIANS = {
    "mj_jacBody": "nbody",
    "mj_jacBodyCom": "nbody",
    "mj_jacGeom": "ngeom",
    "mj_jacSite": "nsite",
}
CAMERAS = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <light mode="trackcom" pos="0 0 3"/>
    <camera mode="targetbodycom" target="ball" pos="1 1 1"/>
    <site name="anchor" pos="0 0 1"/>
    <body name="ball" pos="0 0 .3">
      <freejoint/>
      <geom size=".1"/>
      <geom size=".1" pos=".1 0 0"/>
      <site name="hook"/>
    </body>
  </worldbody>
  <tendon>
    <spatial><site site="anchor"/><site site="hook"/></spatial>
  </tendon>
</mujoco>
"""


def models() -> list[mujoco.MjModel]:
    names = ("humanoid", "muscle_arm", "cube_table", "gripper")
    files = [str(ROOT / "models" / f"{name}.xml") for name in names]
    loaded = [mujoco.MjModel.from_xml_path(file) for file in files]
    return [*loaded, mujoco.MjModel.from_xml_string(CAMERAS)]


def stepped(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = 0.3
    mujoco.mj_step(model, data, 50)
    return data


def copied(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    other = mujoco.MjData(model)
    mujoco.mj_copyData(other, model, data)
    return other


@pytest.mark.parametrize("last", COMPUTED)
def test_the_functions_named_give_bit_for_bit_what_mj_forward_gives(last: str) -> None:
    for model in models():
        data = stepped(model)
        whole = copied(model, data)
        mujoco.mj_forward(model, whole)
        for name in NEEDED[last]:
            getattr(mujoco, name)(model, data)
        fields = [f for name in NEEDED[last] for f in COMPUTED[name]]
        for field in fields:
            assert np.array_equal(getattr(data, field), getattr(whole, field)), field


def test_jacobians_need_positions_and_centres_of_mass_only() -> None:
    for model in models():
        data = stepped(model)
        whole = copied(model, data)
        mujoco.mj_forward(model, whole)
        for name in NEEDED["mj_comPos"]:
            getattr(mujoco, name)(model, data)
        for name, size in JACOBIANS.items():
            for index in range(min(getattr(model, size), 4)):
                ours, theirs = np.zeros((2, 3, model.nv)), np.zeros((2, 3, model.nv))
                getattr(mujoco, name)(model, data, *ours, index)
                getattr(mujoco, name)(model, whole, *theirs, index)
                assert np.array_equal(ours, theirs), name


def test_mj_forward_changes_no_state() -> None:
    for model in models():
        data = stepped(model)
        whole = copied(model, data)
        mujoco.mj_forward(model, whole)
        for field in STATE:
            difference = np.subtract(getattr(data, field), getattr(whole, field), dtype=float)
            assert np.abs(difference).max(initial=0) < 1e-15, field  # 2.3.7 normalizes qpos


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("log.append(data.qpos.copy())", ()),
        ("speed = data.qvel[0] * data.time", ()),
        ("angle = data.joint('hip').qpos[0]", ()),
        ("height = data.xpos[1, 2]", NEEDED["mj_kinematics"]),
        ("tip = data.site('tip').xpos - goal", NEEDED["mj_kinematics"]),
        ("site = data.site('tip'); tip = site.xpos[0]", NEEDED["mj_kinematics"]),
        ("pose = data.body('hand').xquat.copy()", NEEDED["mj_kinematics"]),
        ("com = data.subtree_com[0]", NEEDED["mj_comPos"]),
        ("mujoco.mj_jacSite(model, data, jacp, None, 0)", NEEDED["mj_comPos"]),
        ("eye = data.cam_xpos[0]", NEEDED["mj_camlight"]),
        ("length = data.ten_length[0]", NEEDED["mj_tendon"]),
        (
            "length = data.ten_length[0] + data.cam_xpos[0, 0]",
            ("mj_kinematics", "mj_comPos", "mj_camlight", "mj_tendon"),
        ),
    ],
)
def test_what_is_read_decides_what_is_enough(line: str, instead: Sequence[str]) -> None:
    for text in (
        LOOP.format(before="pass", line=line),
        LOOP.format(before=line, line="data.ctrl[:] = 0"),
    ):
        (finding,) = findings(text, "MJB007")
        assert finding.line == 10
        assert finding.instead == tuple(instead)
        for name in instead:
            assert f"{name}(model, data)" in finding.message
        assert ("delete it" in finding.message) is not bool(instead)


@pytest.mark.parametrize(
    "line",
    [
        "a = data.qacc",
        "n = data.ncon",
        "c = data.contact[0]",
        "s = data.sensordata[0]",
        "s = data.sensor('touch').data",
        "f = data.body('foot').cvel",
        "f = data.actuator('motor').force",
        "e = data.energy",
        "renderer.update_scene(data)",
        "viewer.sync(data)",
        "reward(data)",
        "self.data = data",
        "log.append(data)",
        "mujoco.mj_copyData(other, model, data)",
        "mujoco.mj_step2(model, data)",
        "mujoco.mj_contactForce(model, data, 0, force)",
        "value = getattr(data, name)",
        "body = data.body('foot'); observe(body)",
        "mujoco.set_mjcb_passive(callback)",
        "other = [data]",
        "def later(): return data.qacc",
    ],
)
def test_anything_else_that_is_read_or_not_known_is_no_finding(line: str) -> None:
    assert findings(LOOP.format(before="pass", line=line), "MJB007") == []
    assert findings(LOOP.format(before=line, line="pass"), "MJB007") == []


@pytest.mark.parametrize(
    ("step", "forward"),
    [
        ("mujoco.mj_step(model, data)", "data.ctrl[:] = 0; mujoco.mj_forward(model, data)"),
        ("mujoco.mj_step(model, data)", "data.qpos[0] = 1; mujoco.mj_forward(model, data)"),
        ("mujoco.mj_step(model, other)", "mujoco.mj_forward(model, data)"),
        ("mujoco.mj_step(other, data)", "mujoco.mj_forward(model, data)"),
        ("mujoco.mj_resetData(model, data)", "mujoco.mj_forward(model, data)"),
        ("mujoco.mj_step(model, data)", "place(x); mujoco.mj_forward(model, data)"),
        ("mujoco.mj_step(model, data)", "if done: mujoco.mj_forward(model, data)"),
    ],
)
def test_only_mj_forward_right_after_mj_step_is_found(step: str, forward: str) -> None:
    text = LOOP.replace("mujoco.mj_step(model, data)", step)
    text = text.replace("mujoco.mj_forward(model, data)", forward)
    text = text.format(before="mujoco.mj_step(model, data)\n    x = 1", line="x = data.xpos")
    assert findings(text, "MJB007") == []


def test_several_steps_before_mj_forward_count_as_one() -> None:
    text = LOOP.replace(
        "    mujoco.mj_step(model, data)",
        "    for _ in range(5):\n        mujoco.mj_step(model, data)\n    t = 0",
    )
    (finding,) = findings(text.format(before="pass", line="x = data.xpos"), "MJB007")
    assert finding.instead == ("mj_kinematics",)


FUNCTIONS = """
def observe(data):
    return {read}

def reward():
    return -np.linalg.norm(data.site("tip").xpos)

def run(model, data):
    for _ in range(9):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        observation, r = observe(data), reward()

data = mujoco.MjData(model)
run(model, data)
{after}
"""


def test_functions_of_the_file_are_followed() -> None:
    (finding,) = findings(FUNCTIONS.format(read="data.qpos", after=""), "MJB007")
    assert finding.instead == ("mj_kinematics",)
    (finding,) = findings(FUNCTIONS.format(read="data.subtree_com", after=""), "MJB007")
    assert finding.instead == ("mj_kinematics", "mj_comPos")


@pytest.mark.parametrize(
    ("read", "after"),
    [
        ("data.qacc", ""),
        ("data", ""),
        ("data.qpos", "print(data.ncon)"),
        ("data.qpos", "export(data)"),
        ("data.qpos", "run(*arguments)"),
        ("data.qpos", "pool.submit(run, model, other)"),
    ],
)
def test_what_functions_and_callers_read_counts(read: str, after: str) -> None:
    assert findings(FUNCTIONS.format(read=read, after=after), "MJB007") == []


def test_an_mjdata_that_comes_from_elsewhere_is_no_finding() -> None:
    text = LOOP.format(before="pass", line="x = data.xpos")
    for elsewhere in ("env.unwrapped.data", "load(model)", "datas[0]"):
        changed = text.replace("mujoco.MjData(model)", elsewhere)
        assert findings(changed, "MJB007") == []
    method = "class Env:\n    def run(self, model, data):\n        while True:\n"
    method += (
        "            mujoco.mj_step(model, data)\n            mujoco.mj_forward(model, data)\n"
    )
    assert findings(method, "MJB007") == []


SOLVING = """
data = mujoco.MjData(model)
for _ in range(9):
    mujoco.mj_forward(model, data)
    mujoco.mj_jacBody(model, data, jacobian, None, 3)
    {line}
    mujoco.mj_integratePos(model, data.qpos, velocity, 0.1)
"""


def test_a_loop_that_sets_positions_and_does_not_step_needs_no_forces():
    text = SOLVING.format(line="error = target - data.xpos[3]")
    (finding,) = findings(text, "MJB007")
    assert finding.instead == ("mj_kinematics", "mj_comPos")
    assert "mj_step" not in finding.message


@pytest.mark.parametrize("line", ["mujoco.mj_step(model, data)", "x = data.qacc", "solve(data)"])
def test_a_loop_that_steps_or_reads_forces_needs_all_of_mj_forward(line):
    assert findings(SOLVING.format(line=line), "MJB007") == []


@pytest.mark.parametrize("text", ["str({})", "repr({})", "format({})", "f'{{{}}}'", "'%s' % {}"])
@pytest.mark.parametrize("read", ["data", "data.sensordata", "data.qfrc_constraint[0]"])
def test_what_becomes_text_is_read(text: str, read: str) -> None:
    line = f"data.ctrl[0] = len({text.format(read)})"
    assert not findings(LOOP.format(before="pass", line=line), "MJB007")
    assert findings(LOOP.format(before="pass", line="pass"), "MJB007")
