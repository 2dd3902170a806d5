"""What lint finds in a script, and what it must leave alone."""

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from commands import ROOT, mjbench

from mjbench.errors import InputError
from mjbench.loop import lint

LOOP = """
import mujoco
import numpy as np

data = mujoco.MjData(model)
log, rows, table = [], {{}}, np.empty((100, model.nq))
for i in range(100):
    mujoco.mj_step(model, data)
    {line}
"""


def findings(tmp_path: Path, text: str) -> list[lint.Finding]:
    file = tmp_path / "script.py"
    file.write_text(textwrap.dedent(text))
    return lint.check(str(file))


def codes(tmp_path: Path, line: str) -> list[str]:
    return [f.code for f in findings(tmp_path, LOOP.format(line=line))]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("log.append(data.qpos)", "MJB001"),
        ("log.append(data.qpos[:3])", "MJB001"),
        ("log.append(data.qpos.ravel())", "MJB001"),
        ("log.append((data.time, data.qvel))", "MJB001"),
        ("log.append({'q': data.qpos})", "MJB001"),
        ("log.append(np.asarray(data.qpos))", "MJB001"),
        ("log.append(data.xpos[2])", "MJB001"),
        ("rows[i] = data.qpos", "MJB001"),
        ("rows[i] = data.xmat.reshape(-1)", "MJB001"),
        ("self.last = data.qpos", "MJB001"),
        ("x = data.joint('hinge').qpos[0]", "MJB002"),
        ("n = mujoco.mj_name2id(model, 1, 'box')", "MJB002"),
        ("state = np.concatenate([data.qpos, data.qvel])", "MJB003"),
        ("u = np.zeros(model.nu)", "MJB003"),
        ("near = [c for c in range(len(data.contact))]", "MJB004"),
        ("deep = data.contact.dist.min()", "MJB004"),
    ],
)
def test_what_is_found(tmp_path: Path, line: str, code: str) -> None:
    assert codes(tmp_path, line) == [code]


@pytest.mark.parametrize(
    "line",
    [
        "log.append(data.qpos.copy())",
        "log.append(np.array(data.qpos))  # noqa: MJB003",
        "log.append(data.qpos[0])",
        "log.append(data.time)",
        "log.append(data.qpos + 0.0)",
        "table[i] = data.qpos",
        "table[i] = np.sin(data.qpos)",
        "np.concatenate([data.qpos, data.qvel], out=table[i])",
        "x = data.qpos[0]",
        "n = data.ncon",
        "d = data.contact.dist[: data.ncon]",
        "log.append(data.qpos)  # noqa: MJB001",
        "log.append(data.qpos)  # noqa",
        "log.append(other.qpos)",
        "x = np.add(data.qpos, data.qpos)",
        "data.ctrl = data.qpos",
        "self.last = data.qpos.copy()",
        "if i == 12: u = np.zeros(model.nu)",
    ],
)
def test_what_is_left_alone(tmp_path: Path, line: str) -> None:
    assert codes(tmp_path, line) == []


def test_a_noqa_of_another_rule_excuses_nothing(tmp_path: Path) -> None:
    assert codes(tmp_path, "log.append(data.qpos)  # noqa: MJB002, E501") == ["MJB001"]


def test_a_comprehension_that_steps_is_a_loop(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        """
        def advance():
            mj_step(model, data)
            return True
        log = [data.qpos for _ in range(9) if advance()]
        """,
    )
    assert [f.code for f in found] == ["MJB001"]


def test_episodes_with_a_new_mjdata_and_a_double_loop(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        """
        for episode in range(10):
            data = mujoco.MjData(model)
            for i in range(100):
                mujoco.mj_step(model, data)
        """,
    )
    assert [f.code for f in found] == ["MJB006", "MJB005"]


def test_what_runs_once_an_episode_is_not_in_every_step(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        """
        for episode in range(10):
            q = data.joint('x').qpos
            u = np.zeros(3)
            for t in np.arange(100):
                mujoco.mj_step(model, data)
                for name in names:
                    x = data.joint(name).qpos[0]
        for u in np.array(controls):
            mujoco.mj_step(model, data)
        """,
    )
    assert [(f.line, f.code) for f in found] == [(8, "MJB002")]


def test_a_new_mjdata_of_a_new_model_is_no_habit(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        """
        for mass in masses:
            model = mujoco.MjModel.from_xml_string(xml)
            data = mujoco.MjData(model)
            for i in range(100):
                mujoco.mj_step(model, data)
        """,
    )
    assert [f.code for f in found] == ["MJB006"]


def test_costs_are_those_of_the_stored_table(tmp_path: Path) -> None:
    assert {rule.source for rule in lint.RULES if rule.source} <= set(lint.costs())
    (found,) = findings(tmp_path, LOOP.format(line="n = np.concatenate([data.qpos, data.qvel])"))
    assert found.ns_per_step == lint.costs()["concatenate"] > 0
    (found,) = findings(tmp_path, LOOP.format(line="n = np.zeros(9)"))
    assert found.ns_per_step == lint.costs()["allocate zeros"] > 0


def test_a_loop_that_does_not_step_is_not_looked_at(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        """
        data = mujoco.MjData(model)
        for name in names:
            log.append(data.joint(name).qpos)
        """,
    )
    assert found == []


def test_names_of_the_data_follow_from_their_use(tmp_path: Path) -> None:
    found = findings(
        tmp_path,
        """
        class Env:
            def step(self, u):
                for _ in range(self.skip):
                    mujoco.mj_step(self.m, self.d)
                    self.log.append(self.d.qpos)
        """,
    )
    assert [(f.line, f.code) for f in found] == [(6, "MJB001")]


def test_lines_and_columns_are_those_of_an_editor(tmp_path: Path) -> None:
    (found,) = findings(tmp_path, LOOP.format(line="log.append(data.qpos)"))
    assert (found.line, found.col) == (9, 16)


@pytest.mark.parametrize("text", ["def (", "\x00"])
def test_what_is_not_python_is_told(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="script"):
        findings(tmp_path, text)


def test_the_command_prints_like_a_linter_and_exits_1(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(LOOP.format(line="log.append(data.qpos)"))
    done = mjbench("lint", "bad.py", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.startswith("bad.py:9:16 MJB001 a view is kept")
    (found,) = json.loads((tmp_path / "out.json").read_text())["findings"]
    assert set(found) == {"file", "line", "col", "code", "message", "ns_per_step"}


def test_a_clean_file_a_folder_and_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "good.py").write_text(LOOP.format(line="log.append(data.qpos.copy())"))
    assert mjbench("lint", ".", cwd=tmp_path).returncode == 0
    done = mjbench("lint", "missing.py", cwd=tmp_path)
    assert done.returncode == 2
    assert "no such file" in done.stderr


def test_linting_imports_no_engine() -> None:
    code = "import sys, mjbench.lint; sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT)
    assert done.returncode == 0
