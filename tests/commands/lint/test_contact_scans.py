"""Loops over the contacts of a step."""

import pytest
from linted import findings

SETUP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
force = np.zeros(6)
for t in range(steps):
    mujoco.mj_step(model, data)
    {line}
"""
INDEXED = """for i in range(data.ncon):
        contact = data.contact[i]
        if mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, contact.geom1) == "tip":
            mujoco.mj_contactForce(model, data, i, force)"""


def looping(line: str) -> str:
    return SETUP.format(line=line)


@pytest.mark.parametrize(
    "line",
    [
        INDEXED,
        "for c in data.contact: depth += c.dist",
        "for c in data.contact[: data.ncon]: depth += c.dist",
        "for i, c in enumerate(data.contact): depth[i] = c.dist",
        "for c in data.contact: draw(c)",
        "n = data.ncon\n    for i in range(0, n): seen.add(model.geom(data.contact[i].geom1).name)",
        "for i in range(data.ncon):\n"
        "        first = data.contact[i].geom1\n"
        "        seen.add(model.geom(first).name)",
        "if data.ncon: depth = min(c.dist for c in data.contact)",
    ],
)
def test_contacts_that_are_read_one_by_one_are_found(line: str) -> None:
    assert [each.code for each in findings(looping(line))] == ["MJB019"]


@pytest.mark.parametrize(
    "line",
    [
        "depth += data.contact.dist.sum()",
        "for geoms in data.contact.geom: seen.add(tuple(geoms))",
        "for i in range(data.ncon): draw(data.contact[i], model.geom('tip').name)",
        "for i in range(data.ncon): depth += data.contact[i].dist",
        "for i in range(data.ncon): mujoco.mj_contactForce(model, data, i, force)",
        "if t % 100 == 0:\n        for c in data.contact: print(c.dist)",
        "for c in contacts: depth += c.dist",
        "n = len(data.contact)",
    ],
)
def test_other_uses_of_contacts_are_no_finding(line: str) -> None:
    assert findings(looping(line), "MJB019") == []


def test_a_finding_is_about_all_lines_of_the_loop_and_what_it_asks() -> None:
    (finding,) = findings(looping(INDEXED))
    assert (finding.line, finding.last_line) == (10, 13)
    assert "compare ids from before the loop" in finding.message
    assert "efc_force" in finding.message
    (finding,) = findings(looping("for c in data.contact: depth += c.dist"))
    assert finding.last_line is None
    assert "names" not in finding.message


def test_a_function_that_every_step_calls_is_followed() -> None:
    text = """
        def depth(data):
            return sum(c.dist for c in data.contact)
        while True:
            mujoco.mj_step(model, data)
            total += depth(data)
    """
    (finding,) = findings(text)
    assert finding.code == "MJB019"
    assert finding.message.endswith("; the loop in line 7 calls this in every iteration")


@pytest.mark.parametrize(
    "line",
    [
        "for c in data.contact: names.add(model.geom(c.geom1).name)",
        "for i in range(data.ncon):\n"
        "        first, second = data.contact[i].geom1, data.contact[i].geom2\n"
        "        names.add((model.geom(first).name, data.geom(second).xpos[0]))",
        "for pair in data.contact.geom: names.add(model.geom(pair[0]).name)",
    ],
)
def test_names_of_contacts_are_not_to_be_looked_up_before_the_loop(line: str) -> None:
    assert findings(looping(line), "MJB002") == []


def test_names_beside_contacts_are() -> None:
    line = "for c in data.contact: depth += c.dist * data.body('tip').xpos[2]"
    assert len(findings(looping(line), "MJB002")) == 1


METHODS = """
class Env:
    def {name}(self, action):
        for _ in range(5):
            mujoco.mj_step(self.model, self.data)
        return self.{called}()
    def touches(self):
        return any(3 in c.geom for c in self.data.contact)
"""


def test_a_method_that_steps_runs_in_somebodys_loop() -> None:
    text = METHODS.format(name="step", called="touches")
    (finding,) = findings(text, "MJB019")
    assert finding.message.endswith("; step() in line 6 calls this")
    assert findings(METHODS.format(name="step", called="height"), "MJB019") == []
    assert findings(METHODS.format(name="run", called="touches"), "MJB019") == []
