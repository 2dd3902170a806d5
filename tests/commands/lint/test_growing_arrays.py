"""Arrays that a stepping loop makes longer by copying them."""

import pytest
from linted import findings, places

SETUP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
log, rows, marks = np.empty((0, 3)), [], ()
for t in range({count}):
    mujoco.mj_step(model, data)
    {line}
"""


def looping(line: str, count: str = "steps") -> str:
    return SETUP.format(line=line, count=count)


@pytest.mark.parametrize(
    "line",
    [
        "log = np.vstack([log, data.qpos])",
        "log = np.vstack((data.qpos, log))",
        "log = np.append(log, data.qpos[None], axis=0)",
        "log = np.concatenate([log, [np.hstack([data.time, data.ctrl])]])",
        "log = np.hstack([log, data.qpos[:, None]])",
        "log = np.r_[log, data.qpos]",
        "rows = rows + [data.qpos.copy()]",
        "marks += (data.time,)",
    ],
)
def test_what_is_replaced_by_a_longer_copy_in_every_step_is_found(line: str) -> None:
    assert places(looping(line)) == [("MJB018", line)]


@pytest.mark.parametrize(
    "line",
    [
        "log = np.zeros(0); log = np.append(log, data.qpos)",
        "log = np.vstack([log, data.qpos]); log = log[-9:]",
        "log = np.vstack([log[1:], data.qpos])",
        "log = np.vstack([log, data.qpos])[-9:]",
        "row = np.vstack([log, data.qpos])",
        "log = np.concatenate([log])",
        "log = np.concatenate(log)",
        "log += [1.0, 2.0, 3.0]",
        "log = log + [1.0, 2.0, 3.0]",
        "rows += [data.time]",
        "log += (1.0, 2.0, 3.0)",
        "if data.ncon > 9: log = np.vstack([log, data.qpos])",
        "log = stack([log, data.qpos])",
        "for log in parts: log = np.append(log, data.qpos)",
    ],
)
def test_what_begins_anew_or_grows_in_place_or_seldom_is_no_finding(line: str) -> None:
    assert findings(looping(line), "MJB018") == []


def test_a_short_loop_is_no_finding() -> None:
    line = "log = np.vstack([log, data.qpos])"
    assert findings(looping(line, "99"), "MJB018") == []
    assert len(findings(looping(line, "100"), "MJB018")) == 1


ENVIRONMENT = """
class Env:
    def __init__(self):
        self.log = np.empty((0, 3))
    def {beginning}(self):
        self.log = np.empty((0, 3))
    def record(self):
        self.log = np.vstack([self.log, self.data.qpos])
env = Env()
for t in range(steps):
    mujoco.mj_step(env.model, env.data)
    env.record()
"""


def test_an_attribute_grows_in_a_method_that_every_step_calls() -> None:
    (finding,) = findings(ENVIRONMENT.format(beginning="reset_model"), "MJB018")
    assert finding.message.endswith("; the loop in line 13 calls this in every iteration")


def test_an_attribute_that_another_method_begins_anew_is_no_finding() -> None:
    assert findings(ENVIRONMENT.format(beginning="flush"), "MJB018") == []


def test_a_name_of_a_function_begins_anew_with_each_call() -> None:
    text = """
        def observe(data):
            row = data.qpos
            row = np.append(row, data.qvel)
            return row
        for t in range(steps):
            mujoco.mj_step(model, data)
            observe(data)
    """
    assert findings(text, "MJB018") == []


def test_an_attribute_grows_in_a_method_that_steps() -> None:
    text = """
        class Env:
            def step(self, action):
                mujoco.mj_step(self.model, self.data)
                self.log = np.vstack([self.log, self.data.qpos])
                {after}
            def reset(self):
                self.log = np.empty((0, 3))
    """
    assert len(findings(text.format(after="pass"), "MJB018")) == 1
    assert findings(text.format(after="self.log = self.log[-9:]"), "MJB018") == []


ROWS = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
rows = []
for t in range(steps):
    mujoco.mj_step(model, data)
    rows.append(data.qpos.copy())
    seen = np.array(rows)
"""
NORMALIZER = """
class Normalizer:
    def __init__(self):
        self.history = []

    def __call__(self, row):
        self.history.append(row)
        seen = np.array(self.history)
        return row - seen.mean(axis=0)

model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for episode in range(9):
    normalize = Normalizer()
    for t in range(steps):
        data.ctrl[:] = normalize(data.qpos.copy())
        mujoco.mj_step(model, data)
"""


@pytest.mark.parametrize("line", ["np.array(rows)", "np.mean(rows, axis=0)", "np.stack(rows)"])
def test_a_list_that_each_step_copies_whole_is_found(line: str) -> None:
    text = ROWS.replace("np.array(rows)", line)
    assert places(text, "MJB018", "MJB003") == [("MJB018", f"seen = {line}")]


def test_a_list_that_an_object_copies_when_it_is_called_is_found() -> None:
    assert places(NORMALIZER, "MJB018") == [("MJB018", "seen = np.array(self.history)")]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("np.array(rows)", "np.array(rows[-9:])"),
        ("seen = ", "if t > 9: seen = "),
        ("    rows.append", "    if data.ncon: rows.append"),
        ("    seen", "    del rows[:-9]\n    seen"),
        ("    seen", "    rows.pop(0)\n    seen"),
        ("    seen", "    rows = rows[-9:]\n    seen"),
        ("    seen", "    cut(rows)\n    seen"),
        ("    rows.append", "    rows = []\n    rows.append"),
        ("rows = []", "rows = deque(maxlen=9)"),
        ("range(steps)", "range(50)"),
        ("    seen", "seen"),
        ("rows.append(", "others.append("),
    ],
)
def test_a_list_that_is_cut_or_copied_seldom_is_no_finding(old: str, new: str) -> None:
    text = ROWS.replace(old, new)
    assert text != ROWS
    assert findings(text, "MJB018") == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("        return row", "        self.history = self.history[-9:]\n        return row"),
        ("        return row", "        self.history.pop(0)\n        return row"),
        ("= normalize(data.qpos.copy())", "= 0"),
        ("self.history = []", "self.history = deque(maxlen=9)"),
    ],
)
def test_an_object_that_cuts_its_list_or_is_not_called_is_no_finding(old: str, new: str) -> None:
    text = NORMALIZER.replace(old, new)
    assert text != NORMALIZER
    assert findings(text, "MJB018") == []
