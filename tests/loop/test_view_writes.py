"""What is stored to be written through is no log: lint is silent, and --fix changes no result."""

import itertools
from pathlib import Path

import pytest

from mjbench.loop import lint, lint_fixes

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
TAIL = "\nresult = data.qpos.tobytes() + data.qvel.tobytes() + data.ctrl.tobytes()\n"
LOOPS = ("for i in range(6):\n", "i = -1\nwhile i < 5:\n    i += 1\n")
VIEWS = ("data.qpos", "data.qvel", "data.ctrl", "self.data.qpos", "data.joint('slider').qpos")
# Lines of a loop: a view is stored, and perhaps written through, before a step.
STORED = (
    ["log.append({view})"],
    ["rows[i] = {view}"],
    ["self.last = {view}", "self.last[:] = 0.1 * i"],
    ["self.last = {view}", "self.last += 0.01"],
    ["rows[i] = {view}", "rows[i][:] = 0.1"],
    ["rows[i] = {view}", "last = rows[i]", "last[:] = 0.1"],
    ["views.append({view})", "views[0][0] = 0.2"],
    ["views.append({view})", "[each.fill(0.1) for each in views]"],
    ["io['a'] = {view}", "io['a'][:] = 0.5"],
    ["a = rows[i] = {view}", "a[:] = 0.4"],
)


def program(loop: str, view: str, lines: list[str]) -> str:
    body = [*(line.format(view=view) for line in lines), "mujoco.mj_step(model, data)"]
    return HEAD + loop + "".join(f"    {line}\n" for line in body) + TAIL


PROGRAMS = [program(*parts) for parts in itertools.product(LOOPS, VIEWS, STORED)]


def result_of(text: str) -> bytes:
    names: dict[str, bytes] = {}
    exec(text, names)
    return names["result"]


def test_a_hundred_programs_compute_the_same_when_they_are_fixed(tmp_path: Path) -> None:
    assert len(PROGRAMS) == 100
    changed = 0
    for number, text in enumerate(PROGRAMS):
        file = tmp_path / f"p{number}.py"
        file.write_text(text)
        fixed = lint_fixes.fix(str(file))
        changed += fixed.after.parts[0].text.count(".copy()")
        fixed.write()
        assert result_of(file.read_text()) == result_of(text), text
    assert changed == 6  # appended to `log`, of `data`, and no input


def codes(tmp_path: Path, body: str) -> list[str]:
    file = tmp_path / "script.py"
    file.write_text(HEAD + body)
    return [finding.code for finding in lint.check(str(file))]


@pytest.mark.parametrize("lines", STORED[2:], ids=lambda lines: lines[-1])
def test_what_is_written_through_is_no_finding(tmp_path: Path, lines: list[str]) -> None:
    file = tmp_path / "script.py"
    file.write_text(program(LOOPS[0], "data.qpos", lines))
    assert lint.check(str(file), ["MJB001"]) == []


def test_what_another_method_writes_through_is_no_finding(tmp_path: Path) -> None:
    text = (
        "class Env:\n"
        "    def step(self, action):\n"
        "        self.q = self.data.qpos\n"
        "        mujoco.mj_step(self.model, self.data)\n"
        "    def act(self, action):\n"
        "        self.q[:] = action\n"
    )
    assert codes(tmp_path, text) == []


@pytest.mark.parametrize("field", ["ctrl", "qfrc_applied", "mocap_pos", "userdata", "act"])
def test_views_of_inputs_are_stored_to_be_written(tmp_path: Path, field: str) -> None:
    text = f"for i in range(9):\n    mujoco.mj_step(model, data)\n    log.append(data.{field})\n"
    assert codes(tmp_path, text) == []


def test_a_view_of_an_mjdata_of_the_same_iteration_is_no_finding(tmp_path: Path) -> None:
    text = (
        "for i in range(9):\n"
        "    data = mujoco.MjData(model)\n"
        "    for _ in range(9):\n"
        "        mujoco.mj_step(model, data)\n"
        "    log.append(data.qpos)\n"
    )
    assert "MJB001" not in codes(tmp_path, text)


def test_contacts_are_exactly_those_of_the_step(tmp_path: Path) -> None:
    text = (
        "for i in range(9):\n"
        "    mujoco.mj_step(model, data)\n"
        "    deepest = min((c.dist for c in data.contact), default=0)\n"
        "    n = len(data.contact)\n"
    )
    assert codes(tmp_path, text) == []


@pytest.mark.parametrize(
    "line",
    [
        "import sys; sys.modules[__name__].data = other",
        "setattr(here, 'data', other)",
        "import loops; loops.data = other",
    ],
)
def test_a_name_that_may_be_set_from_elsewhere_is_not_hoisted(tmp_path: Path, line: str) -> None:
    file = tmp_path / "script.py"
    file.write_text(
        HEAD
        + f"def swap():\n    {line}\n"
        + "for i in range(9):\n    mujoco.mj_step(model, data)\n"
        + "    x = data.joint('hinge').qpos\n"
    )
    assert lint_fixes.fix(str(file), ["MJB002"]).fixed == 0
