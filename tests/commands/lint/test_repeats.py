"""What functions do that a stepping loop calls: look names up, create arrays."""

import pytest
from linted import findings, places

SCRIPT = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
def observe():
    {helper}
for i in range(9):
    {before}
    for t in range(99):
        mujoco.mj_step(model, data)
        {call}
"""


def script(helper: str, call: str = "observe()", before: str = "pass") -> str:
    return SCRIPT.format(helper=helper, call=call, before=before)


HELPERS = [
    ("return data.body('torso').xpos[2]", "MJB002"),
    ("return model.joint('hip').range", "MJB002"),
    ("return data.xpos[mujoco.mj_name2id(model, 1, 'torso')]", "MJB002"),
    ("for name in names: x = data.joint(name).qpos[0]", "MJB002"),
    ("return np.concatenate([data.qpos, data.qvel])", "MJB003"),
    ("a = np.zeros(3); a[:] = data.qpos[:3]; return a.sum()", "MJB003"),
]


@pytest.mark.parametrize(("helper", "code"), HELPERS)
def test_a_function_that_each_step_calls_is_in_the_loop(helper: str, code: str) -> None:
    (finding,) = findings(script(helper), "MJB002", "MJB003")
    assert (finding.code, finding.line) == (code, 8)
    assert finding.message.endswith("; the loop in line 11 calls this in every iteration")
    assert finding.ns_per_step


@pytest.mark.parametrize(
    "call",
    [
        "x = observe() + 1",
        "def look(): return observe()\n        x = look()",
        "for _ in range(2): observe()",
        "if t % 2: observe()",
    ],
)
def test_calls_are_followed_through_expressions_and_functions(call: str) -> None:
    text = script("return data.body('torso').xpos[2]", call)
    assert [code for code, _ in places(text, "MJB002")] == ["MJB002"]


@pytest.mark.parametrize(("helper", "code"), HELPERS)
@pytest.mark.parametrize(
    ("call", "before"),
    [
        ("pass", "observe()"),
        ("if t == 3: observe()", "pass"),
        ("pass", "pass"),
        ("callback = observe", "pass"),
        ("other.observe()", "pass"),
        ("try: pass\n        except KeyError: observe()", "pass"),
    ],
)
def test_a_function_that_not_every_step_calls_is_not(
    helper: str, code: str, call: str, before: str
) -> None:
    assert findings(script(helper, call, before), code) == []


def test_what_a_function_does_under_a_condition_is_not_in_every_step() -> None:
    helper = "if data.time > 1: return np.zeros(3)"
    assert findings(script(helper), "MJB003") == []


def test_a_function_that_steps_runs_in_the_loop_that_calls_it() -> None:
    text = """
    def advance():
        mujoco.mj_step(model, data)
        return data.body("torso").xpos[2]
    for i in range(9):
        advance()
    """
    assert places(text, "MJB002") == [("MJB002", 'return data.body("torso").xpos[2]')]
    episode = text.replace("mujoco", "for _ in range(9): mujoco")
    assert findings(episode, "MJB002") == [], "once for nine steps"


def test_methods_of_an_object_of_the_script_are_followed() -> None:
    text = """
    class Env:
        def observe(self):
            return self.data.body("torso").xpos[2]
        def step(self, action):
            mujoco.mj_step(self.model, self.data)
            return self.observe()
        def reset(self):
            return self.data.joint("hip").qpos[0]
    env = Env()
    env.reset()
    for i in range(9):
        env.step(0)
    """
    expected = [("MJB002", 'return self.data.body("torso").xpos[2]')]
    assert places(text, "MJB002") == expected
