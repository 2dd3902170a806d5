"""Rows of a log that mix the new state with what is computed from another."""

import mujoco
import numpy as np
import pytest
from commands import ROOT
from linted import findings

from mjbench.commands.lint.moments import is_computed

LOOP = """
import csv, time
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
log, table, qpos, tip = [], np.empty((9, 9)), data.qpos, data.site("tip")
for i in range(9):
    {lines}
"""
STEP = "mujoco.mj_step(model, data)"
ROW = "log.append((data.qpos.copy(), data.xpos.copy()))"


def messages(*lines: str) -> list[str]:
    """Return the messages for a loop of some lines."""
    text = LOOP.format(lines="\n    ".join(lines))
    return [finding.message for finding in findings(text, "MJB015")]


@pytest.mark.parametrize(
    "row",
    [
        ROW,
        "log.append([data.time, *data.sensordata])",
        "log.append({'q': data.qpos.copy(), 'contacts': data.ncon})",
        "log.append(np.concatenate([data.qpos, data.qvel, data.qacc]))",
        "table[i] = np.hstack([data.qvel, data.sensordata])",
        "table[i, :] = data.act[0], data.geom_xpos[1, 2]",
        "log.append((data.joint('hip').qpos[0], data.sensor('gyro').data.copy()))",
        "log.append((qpos.copy(), tip.xpos.copy()))",
        "writer.writerow([data.time, data.cvel[1, 0]])",
        "file.write(f'{data.time} {data.ten_length[0]}')",
        "row = np.concatenate([data.qpos, data.actuator_force]); log.append(row)",
        "if i % 3 == 0: " + ROW,
        "for k in range(2): log.append((data.qpos[k], data.xpos[k, 2]))",
    ],
)
def test_a_row_of_two_moments_is_a_wrong_result(row: str) -> None:
    assert len(messages(STEP, row)) == 1
    assert len(messages(row, STEP)) == 1, "what stands after a row ran before it"


@pytest.mark.parametrize(
    "lines",
    [
        ("for _ in range(5): mujoco.mj_step(model, data)", ROW),
        ("mujoco.mj_step(model, data, 5)", ROW),
        ("mujoco.mj_step1(model, data)", "mujoco.mj_step2(model, data)", ROW),
        (STEP, "u = np.sin(data.time)", "x = data.body('torso').xpos[2]", "print(u)", ROW),
        ("mujoco.mj_forward(model, data)", STEP, ROW),
        ("data.ctrl[:] = policy(data)", STEP, ROW),
        (STEP, "mujoco.mj_kinematics(model, data)", "log.append((*data.qpos, *data.sensordata))"),
    ],
)
def test_the_last_call_that_computes_is_the_step(lines: tuple[str, ...]) -> None:
    assert len(messages(*lines)) == 1


@pytest.mark.parametrize(
    "lines",
    [
        (STEP, "mujoco.mj_forward(model, data)", ROW),
        (STEP, "mujoco.mj_kinematics(model, data)", ROW),
        (STEP, ROW, "mujoco.mj_forward(model, data)")[::-1],
        ("mujoco.mj_step1(model, data)", ROW, "mujoco.mj_step2(model, data)"),
        ("mujoco.mj_step2(model, data)", "mujoco.mj_step1(model, data)", ROW),
        (STEP, "if i: mujoco.mj_forward(model, data)", ROW),
        ("if i: mujoco.mj_step(model, data)", ROW),
        (STEP, "update(data)", ROW),
        (STEP, "viewer.sync()", ROW),
        (STEP, "def len(x): mujoco.mj_forward(model, data)", "len(data)", ROW),
        (STEP, "mujoco.mj_inverse(model, data)", ROW),
        (STEP, "data.qpos[0] = 0", ROW),
        ("mujoco.mj_step(model, other)", ROW),
    ],
)
def test_what_may_be_computed_again_is_no_finding(lines: tuple[str, ...]) -> None:
    assert messages(*lines) == []


@pytest.mark.parametrize(
    "line",
    [
        "log.append((data.qpos.copy(), data.qvel.copy(), data.time, data.ctrl.copy()))",
        "log.append((data.xpos.copy(), data.sensordata.copy(), data.qacc.copy()))",
        "log.append(data.xpos.copy())",
        "log.append((data.qpos.copy(), other.xpos.copy()))",
        "log.append((data.qpos.copy(), data.mocap_pos.copy(), data.qacc_warmstart.copy()))",
        "log.append(data.qpos.copy()); other.append(data.xpos.copy())",
        "data.ctrl[i] = data.qpos[0] - data.xpos[1, 2]",
        "x = np.log(data.qpos[0] + data.xpos[1, 2])",
        "action = policy(np.concatenate([data.qpos, data.sensordata]))",
        "table[:] = np.concatenate([data.qpos, data.sensordata])",
        "self.now = data.qpos[0], data.xpos[1, 2]",
        "log.append(lambda: (data.qpos.copy(), data.xpos.copy()))",
    ],
)
def test_rows_of_one_moment_and_what_is_no_row_are_no_finding(line: str) -> None:
    assert messages(STEP, line) == []


def test_a_state_that_was_copied_before_the_step_is_of_the_same_moment() -> None:
    row = "log.append((before, data.xpos.copy()))"
    assert messages("before = data.qpos.copy()", STEP, row) == []


def test_a_row_outside_of_loops_that_step_is_no_finding() -> None:
    assert messages(STEP.replace("mj_step", "mj_forward"), ROW) == []


def test_a_method_that_steps_runs_in_somebodys_loop() -> None:
    row = "self.log.append((self.data.qpos.copy(), self.data.xpos.copy()))"
    step = "mujoco.mj_step(self.model, self.data)"
    text = """
    class Env:
        def step(self, action):
            {}
            {}
            return np.concatenate([self.data.qpos, self.data.sensordata])
    """
    (finding,) = findings(text.format(step, row), "MJB015")
    assert (finding.line, finding.is_wrong_result) == (8, True)
    assert findings(text.format(row, step), "MJB015") == [], "a caller may compute again"


@pytest.mark.parametrize(
    ("row", "calls"),
    [
        (ROW, "call mj_kinematics(model, data) before"),
        ("log.append((data.time, data.ten_length[0]))", "mj_tendon(model, data) before"),
        ("log.append((data.time, data.sensordata[0]))", "call mj_forward(model, data) before"),
    ],
)
def test_the_message_says_what_computes_what_is_read(row: str, calls: str) -> None:
    (message,) = messages(STEP, row)
    assert calls in message


def test_the_message_says_which_fields_are_of_which_state() -> None:
    row = "log.append((data.time, data.qpos.copy(), data.xpos.copy(), data.ncon))"
    (message,) = messages(STEP, row)
    assert message.startswith("ncon and xpos still belong to the state before the last step, qpos")


def test_a_copy_of_the_state_is_offered_before_a_single_step_alone() -> None:
    (message,) = messages(STEP, ROW)
    assert message.endswith(", or copy qpos before the step and the rest after it")
    for steps in ("mujoco.mj_step(model, data, 5)", f"for _ in range(5): {STEP}"):
        (message,) = messages(steps, ROW)
        assert message.endswith("call mj_kinematics(model, data) before this row")


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICIT", "IMPLICITFAST"])
@pytest.mark.parametrize("name", ["humanoid", "muscle_arm", "cube_table", "gripper"])
def test_a_step_leaves_what_it_computed_as_it_was_before_it(name: str, integrator: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(ROOT / "models" / f"{name}.xml"))
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    data, before = mujoco.MjData(model), mujoco.MjData(model)
    data.ctrl[:] = 0.3
    mujoco.mj_step(model, data, 50)
    mujoco.mj_copyData(before, model, data)
    mujoco.mj_forward(model, before)
    mujoco.mj_step(model, data)
    assert not np.array_equal(data.qpos, before.qpos)
    fields = [f for f in dir(data) if is_computed(f) and f != "contact"]
    assert len(fields) > 80
    for field in fields:
        assert np.array_equal(getattr(data, field), getattr(before, field)), field
