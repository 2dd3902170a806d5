"""Which stored views `--fix` copies: where nothing changes but what the log shows."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjbench.loop import lint, lint_fixes

HEAD = """\
import contextlib, functools, operator, pickle
from collections import deque, namedtuple
from unittest import mock
import mujoco
import numpy as np
model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body name="a">
<joint name="hip" axis="0 1 0"/><geom size=".1" pos=".5 0 0"/><body name="b" pos="1 0 0">
<joint name="knee" axis="0 1 0"/><geom size=".1" pos=".5 0 0"/></body></body></worldbody>
<actuator><motor joint="hip"/></actuator><sensor><jointpos name="s" joint="hip"/></sensor></mujoco>
''')
data = mujoco.MjData(model)
log = []
"""
STEPS = "for i in range(4):\n    mujoco.mj_step(model, data)\n"
STORED = STEPS + "    log.append(data.qpos)\n"
EPISODES = "for episode in range(2):\n    mujoco.mj_resetData(model, data)\n"
CODES = ("MJB001", "MJB002")


def result_of(text: str) -> dict[str, Any]:
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(text, "script.py", "exec"), names)
    return names


def fixed(file: Path, text: str) -> lint_fixes.LintedFile:
    file.write_text(text, encoding="utf-8")
    return lint_fixes.fix(str(file), CODES)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "script.py"


@pytest.mark.parametrize(
    "body",
    [
        STORED,
        STORED + "print(log, len(log), f'{log}')\n",
        STORED + "path = np.stack(log)\nmean = np.mean(log, axis=0)\n",
        STORED + "assert pickle.dumps(np.array(log))\n",
        STEPS + "    q = data.qpos\n    log.append(q)\n",
        STEPS + "    if i % 2 == 0:\n        log.append(data.qpos[:1])\n",
        STEPS + "    log.append((data.time, data.qpos))\n",
        STEPS + "    log.append({'q': data.sensor('s').data})\n",
        STEPS + "    log.append(data.body('b').xpos[:2])\nx = np.vstack(log)\n",
        STEPS + "    log.append(data.xpos[2])\n    if len(log) > 2: break\n",
        "rows = {}\n" + STEPS + "    rows[i] = data.qpos\nlog.append(1)\nprint(rows)\n",
        "tail = deque(maxlen=3)\n" + STEPS + "    tail.append(np.asarray(data.qvel))\n",
        EPISODES
        + "    path = []\n    for t in range(3):\n        mujoco.mj_step(model, data)\n"
        + "        path.append(data.qpos)\n    log.append(np.array(path))\n",
        "for episode in range(2):\n    data = mujoco.MjData(model)\n    for t in range(3):\n"
        "        mujoco.mj_step(model, data)\n        log.append(data.qpos)\n",
        "def run(model, data, n):\n    path = []\n    for t in range(n):\n"
        "        mujoco.mj_step(model, data)\n        path.append(data.qpos)\n"
        "    return np.array(path)\nlog.append(run(model, data, 3))\n",
    ],
)
def test_a_log_that_is_only_read_shows_each_state_and_all_else_stays(file: Path, body: str) -> None:
    result = fixed(file, HEAD + body)
    assert result.fixed == 1 + ("data.body(" in body or "data.sensor(" in body)
    assert result.findings == []
    before, after = result_of(HEAD + body), result_of(result.after.parts[0].text)
    for name in ("qpos", "qvel", "ctrl"):
        np.testing.assert_array_equal(getattr(before["data"], name), getattr(after["data"], name))
    logs = [[repr(names.get(n)) for n in ("log", "rows", "tail")] for names in (before, after)]
    assert logs[0] != logs[1]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (STORED + "last = log[-1]\n", "line 16 may do more with log than read and copy it"),
        (STORED + "same = log\n", "line 16 may do more"),
        (STORED + "total = sum(q[0] for q in log)\n", "line 16 may do more"),
        (STORED + "a = np.array(log, dtype=object)\n", "line 16 may do more"),
        (STORED + "    u = np.mean(log)\n", "line 16 may do more"),
        (STORED + STEPS + "    u = np.mean(log)\n", "line 18 may do more"),
        (STORED + "def u(): return np.mean(log)\n", "line 16 may do more"),
        (STORED + "a = np.concatenate([log[0], log[1]])\n", "line 16 may do more"),
        (STORED + "def use(rows): pass\nuse(log)\n", "line 17 may do more"),
        (STORED + "def len(rows): return 1\nlen(log)\n", "line 17 may do more"),
        (STEPS + "    log.append({'q': data.qpos})\na = np.array(log)\n", "line 16 may do more"),
        (STEPS + "    if data.time > 0: log.append(data.qpos)\n", "not every step stores it"),
        (STORED + "log = []\n", "log is not certain to be a list or a dict that is empty"),
        ("log = [0]\n" + STORED, "log is not certain to be a list or a dict that is empty"),
        ("rows = [None] * 4\n" + STEPS + "    rows[i] = data.qpos\n", "rows is not certain"),
        (STORED + "print(dir())\n", "a global statement, setattr, globals or the like"),
        (STORED + "def end():\n    global log\n    log = []\n", "a global statement"),
        ("def run():\n    for i in range(3):\n        mujoco.mj_step(model, data)\n"
         "        log.append(data.qpos)\n", "log is not of the same function"),
        (STEPS + "    log.extend([1]) or log.append(data.qpos)\n", "only what is appended"),
        ("logs = {'q': []}\n" + STEPS + "    logs['q'].append(data.qpos)\n",
         "only what is appended"),
        ("def go(): mujoco.mj_step(model, data); return 1\n"
         "a = np.array([data.qpos for _ in range(3) if go()])\n", "only what is appended"),
        ("class Sim:\n  def __init__(self): self.data, self.log = data, []\n  def step(self):\n"
         "    mujoco.mj_step(model, self.data)\n    self.log.append(self.data.qpos)\n",
         "only what is appended"),
        ("class Sim: pass\nsim = Sim()\nsim.data = data\nfor i in range(3):\n"
         "    mujoco.mj_step(model, sim.data)\n    log.append(sim.data.qpos)\n",
         "its MjData is not a plain name"),
        ("class Twin(mujoco.MjData): pass\n" + STORED, "data is not certain to be an MjData"),
        ("def step(): mujoco.mj_step(model, data)\nother = data\ndata = other\n"
         "for i in range(3):\n    step()\n    log.append(data.qpos)\n", "data is not certain"),
    ],
)  # fmt: skip
def test_other_findings_stay_and_say_why(file: Path, body: str, reason: str) -> None:
    result = fixed(file, HEAD + body)
    assert result.after is result.before
    result_of(HEAD + body)
    (unfixed,) = result.unfixed
    assert unfixed.finding.code == "MJB001"
    assert unfixed.reason.startswith(reason)


def test_a_log_of_another_cell_is_read_there(tmp_path: Path) -> None:
    file = tmp_path / "run.ipynb"
    sources = [HEAD, STORED, "log"]
    cells = [
        {"cell_type": "code", "metadata": {}, "outputs": [], "source": s.splitlines(keepends=True)}
        for s in sources
    ]
    document = {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    file.write_text(json.dumps(document, indent=1) + "\n")
    (unfixed,) = lint_fixes.fix(str(file), CODES).unfixed
    assert unfixed.reason == "cell 3, line 1 may do more with log than read and copy it"


# Programs that use a view as it is: no finding, and no change.
LIVE = {
    "once per episode": EPISODES
    + "    live = []\n    for j in ('hip', 'knee'):\n        live.append(data.joint(j).qpos)\n"
    + "    for t in range(3):\n        mujoco.mj_step(model, data)\n",
    "key per episode": EPISODES
    + "    live = {}\n    live['q'] = data.qpos\n    for t in range(3):\n"
    + "        mujoco.mj_step(model, data)\n",
    "first step": "live = []\n" + STEPS + "    if i == 0: live.append(data.qpos)\n",
    "unless filled": "live = []\n" + STEPS + "    if not live: live.append(data.qpos)\n",
    "last step": STEPS + "    if data.time > 0:\n        log.append(data.qpos)\n        break\n",
    "registry": "live = {}\n" + STEPS + "    for n in 'ab': live[n] = data.body(n).xpos\n",
    "registry that settles": "for n in 'ab':\n    mujoco.mj_step(model, data)\n"
    "    log.append(data.body(n).xpos)\n",
    "latest": "latest = deque(maxlen=1)\n" + STEPS + "    latest.append(data.qpos)\n",
    "attribute": "class R: pass\nr = R()\n" + STEPS + "    r.q = data.qpos\n",
    "settled": "class R:\n  def __init__(self):\n    self.data, self.live = data, {}\n"
    "    mujoco.mj_step(model, self.data)\n"
    "    for n in 'ab': self.live[n] = self.data.body(n).xpos\nR()\n",
    "simulations": "sims = [mujoco.MjData(model) for _ in range(2)]\nfor d in sims:\n"
    "    mujoco.mj_step(model, d)\n    log.append(d.qpos)\n",
    "simulations by index": "sims = [mujoco.MjData(model) for _ in range(2)]\nfor i in range(2):\n"
    "    d = sims[i]\n    mujoco.mj_step(model, d)\n    log.append(d.qpos)\n",
    "queue": "sims = deque([mujoco.MjData(model)])\nwhile sims:\n    d = sims.popleft()\n"
    "    mujoco.mj_step(model, d)\n    log.append(d.qpos)\n",
    "two, one stepped": "still = mujoco.MjData(model)\n" + STEPS + "    log.append(still.qpos)\n",
    "new by annotation": "for i in range(3):\n    d: mujoco.MjData = mujoco.MjData(model)\n"
    "    mujoco.mj_step(model, d)\n    log.append(d.qpos)\n",
    "new by with": "for i in range(3):\n"
    "    with contextlib.nullcontext(mujoco.MjData(model)) as d:\n"
    "        mujoco.mj_step(model, d)\n        log.append(d.qpos)\n",
    "new environment": "class ArmEnv:\n  def __init__(self): self.data = mujoco.MjData(model)\n"
    "  def step(self, u): mujoco.mj_step(model, self.data)\nfor i in range(3):\n"
    "    env = ArmEnv()\n    env.step(0)\n    log.append(env.data.qpos)\n",
    "new by reset": "class Sim:\n  def __init__(self): self.log = []\n  def reset(self):\n"
    "    self.data = mujoco.MjData(model)\n  def run(self):\n    for i in range(3):\n"
    "      self.reset()\n      mujoco.mj_step(model, self.data)\n"
    "      self.log.append(self.data.qpos)\nSim().run()\n",
    "new by global": "def reset():\n    global data\n    data = mujoco.MjData(model)\n"
    + STORED + "    reset()\n",
    "comprehension over simulations": "def go(d): mujoco.mj_step(model, d); return 1\n"
    "live = [d.qpos for d in [data] if go(d)]\n",
    "inputs": "def go(d): mujoco.mj_step(model, d); return 1\n"
    "u = [data.ctrl for _ in range(3) if go(data)]\n",
    "generator": "def go(): mujoco.mj_step(model, data); return 1\n"
    "total = sum(data.qpos for _ in range(3) if go())\n",
    "parts of a step": STEPS + "    parts = []\n    parts.append(data.qpos)\n"
    "    log.append(np.concatenate(parts))\n",
    "fancy index": "ids = np.array([0, 1])\n" + STEPS + "    log.append(data.xpos[ids, :2])\n",
    "another type": STEPS + "    log.append(np.asarray(data.qpos, dtype=np.float32))\n",
    "a copy by reshape": STEPS + "    log.append(data.xpos[:, :2].ravel())\n",
    "setters": "cam = mujoco.MjvCamera()\n" + STEPS + "    cam.lookat = data.body('b').xpos\n"
    "    model.qpos0 = data.qpos\n",
    "a class that copies": "class Stats:\n    total = 0\n    def append(self, q):\n"
    "        self.total = self.total + q[0]\nstats = Stats()\n" + STEPS
    + "    stats.append(data.qpos)\n",
    "a namedtuple": "sim, Frame = data, namedtuple('Frame', 'qpos')\nfor data in [Frame((0, 0))]:\n"
    "    mujoco.mj_step(model, sim)\n    log.append(data.qpos)\n",
    "an element of a loop": "def start():\n    joint = data.joint('hip')\n    return joint.qpos\n"
    "for joint in [mock.Mock(range=(0, 1))]:\n    mujoco.mj_step(model, data)\n"
    "    log.append(joint.range)\n",
    "an array of the same name": "def first():\n    buf = []\n    return buf\ndef second():\n"
    "    buf = np.zeros((4, 2))\n    for i in range(4):\n        mujoco.mj_step(model, data)\n"
    "        buf[i] = data.qpos\nsecond()\n",
}  # fmt: skip


@pytest.mark.parametrize("case", LIVE)
def test_a_view_that_is_no_entry_of_a_log_is_no_finding(file: Path, case: str) -> None:
    file.write_text(HEAD + LIVE[case], encoding="utf-8")
    assert lint.check(str(file), ["MJB001"]) == []
    result_of(HEAD + LIVE[case])


# Lines that write through entries of the log, after its loop.
WRITES = (
    "v = log[-1]\nv[0] = 0.5",
    "for v in log: v[0] = 0.5",
    "for i, v in enumerate(log): v[:] = i",
    "for v, x in zip(log, (1, 2)): v += x",
    "v = log[0]\nv[v < 10] = 0.5",
    "log[0].flat[0] = 0.5",
    "def kick(q): q[:] = 0.5\nkick(log[-1])",
    "def kick(q=log[0]): q[:] = 0.5\nkick()",
    "def end(): return log\nend()[0][:] = 0.5\nv = end()\nv[0][0] = 1",
    "first, *rest = log\nfirst[:] = 0.5",
    "if (v := log[0]) is not None: v[:] = 0.5",
    "with contextlib.nullcontext(log[0]) as v: v[:] = 0.5",
    "match log:\n    case [v, *_]: v[:] = 0.5",
    "a = np.asarray(log[0])\na[:] = 0.5",
    "a = memoryview(log[0])\na[0] = 0.5",
    "live = list(log)\nlive[0][:] = 0.5",
    "by = dict(zip('ab', log))\nby['a'][:] = 0.5",
    "by = {}\nby.update(q=log)\nby['q'][0][:] = 0.5",
    "list(map(lambda v: v.fill(0.5), log))",
    "np.copyto(log[0], 0.5)",
    "functools.partial(np.copyto, log[0])(0.5)",
    "np.add.at(log[0], 0, 0.5)",
    "np.add(log[0], 0.5, log[0])",
    "np.add(log[0], 0.5, out=log[0])",
    "mujoco.mju_copy(log[0], np.ones(2))",
    "operator.setitem(log[0], 0, 0.5)",
    "np.random.default_rng(3).shuffle(log[0])",
    "q = log.pop()\nq[0] = 0.5",
)


@pytest.mark.parametrize("lines", WRITES)
def test_a_log_that_is_written_through_is_no_finding(file: Path, lines: str) -> None:
    file.write_text(HEAD + STORED + lines + "\n", encoding="utf-8")
    assert lint.check(str(file), ["MJB001"]) == []
    result_of(HEAD + STORED + lines + "\n")
