"""What is stored to be written through is no log: lint is silent."""

import pytest
from linted import check

HEAD = """
import mujoco
from mjbench.simulation import models
model = models.load(models.resolve("cartpole"))
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
class R: pass
self, log, rows, io, views = R(), [], [None] * 9, {}, []
self.data = data
"""
# Lines of a loop: a view is stored, and perhaps written through, before a step.
STORED = (
    ["self.last = {view}", "self.last[:] = 0.1 * i"],
    ["self.last = {view}", "self.last += 0.01"],
    ["rows[i] = {view}", "rows[i][:] = 0.1"],
    ["rows[i] = {view}", "last = rows[i]", "last[:] = 0.1"],
    ["views.append({view})", "views[0][0] = 0.2"],
    ["views.append({view})", "[each.fill(0.1) for each in views]"],
    ["io['a'] = {view}", "io['a'][:] = 0.5"],
    ["a = rows[i] = {view}", "a[:] = 0.4"],
)


def codes(body: str) -> list[str]:
    return [finding.code for finding in check(HEAD + body)]


@pytest.mark.parametrize("lines", STORED, ids=lambda lines: lines[-1])
def test_what_is_written_through_is_no_finding(lines: list[str]) -> None:
    body = [line.format(view="data.qpos") for line in (*lines, "mujoco.mj_step(model, data)")]
    assert "MJB001" not in codes("for i in range(6):\n    " + "\n    ".join(body))


def test_what_another_method_writes_through_is_no_finding() -> None:
    text = (
        "class Env:\n"
        "    def step(self, action):\n"
        "        self.q = self.data.qpos\n"
        "        mujoco.mj_step(self.model, self.data)\n"
        "    def act(self, action):\n"
        "        self.q[:] = action\n"
    )
    assert codes(text) == []


@pytest.mark.parametrize("field", ["ctrl", "qfrc_applied", "mocap_pos", "userdata", "act"])
def test_views_of_inputs_are_stored_to_be_written(field: str) -> None:
    text = f"for i in range(9):\n    mujoco.mj_step(model, data)\n    log.append(data.{field})\n"
    assert codes(text) == []


def test_a_view_of_an_mjdata_of_the_same_iteration_is_no_finding() -> None:
    text = (
        "for i in range(9):\n"
        "    data = mujoco.MjData(model)\n"
        "    for _ in range(9):\n"
        "        mujoco.mj_step(model, data)\n"
        "    log.append(data.qpos)\n"
    )
    assert "MJB001" not in codes(text)
