"""What lint finds in a script, and what it must leave alone."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from commands import ROOT

from mjbench.errors import InputError
from mjbench.loop import habits, lint
from mjbench.loop.lint_rules import ALLOCATION_HABITS, NAMED_ACCESS_HABIT, RULES

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
def test_each_rule_finds_its_pattern(tmp_path: Path, line: str, code: str) -> None:
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
def test_correct_code_has_no_finding(tmp_path: Path, line: str) -> None:
    assert codes(tmp_path, line) == []


def test_noqa_for_another_rule_suppresses_nothing(tmp_path: Path) -> None:
    assert codes(tmp_path, "log.append(data.qpos)  # noqa: MJB002, E501") == ["MJB001"]


def test_a_comprehension_that_steps_is_a_loop(tmp_path: Path) -> None:
    results = findings(
        tmp_path,
        """
        def advance():
            mj_step(model, data)
            return True
        log = [data.qpos for _ in range(9) if advance()]
        """,
    )
    assert [f.code for f in results] == ["MJB001"]


def test_a_new_mjdata_per_episode_and_serial_simulations_are_found(tmp_path: Path) -> None:
    results = findings(
        tmp_path,
        """
        for episode in range(10):
            data = mujoco.MjData(model)
            for i in range(100):
                mujoco.mj_step(model, data)
        """,
    )
    assert [f.code for f in results] == ["MJB006", "MJB005"]


def test_what_runs_once_per_episode_does_not_run_in_every_step(tmp_path: Path) -> None:
    results = findings(
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
    assert [(f.line, f.code) for f in results] == [(8, "MJB002")]


def test_a_new_mjdata_of_a_new_model_is_not_found(tmp_path: Path) -> None:
    results = findings(
        tmp_path,
        """
        for mass in masses:
            model = mujoco.MjModel.from_xml_string(xml)
            data = mujoco.MjData(model)
            for i in range(100):
                mujoco.mj_step(model, data)
        """,
    )
    assert [f.code for f in results] == ["MJB006"]


def test_costs_come_from_the_stored_table(tmp_path: Path) -> None:
    used = {NAMED_ACCESS_HABIT, *ALLOCATION_HABITS.values()}
    assert used <= set(lint.costs_ns())
    assert used <= {habit.name for habit in habits.HABITS}
    (finding,) = findings(tmp_path, LOOP.format(line="n = np.concatenate([data.qpos, data.qvel])"))
    assert finding.ns_per_step == lint.costs_ns()["concatenate"] > 0
    (finding,) = findings(tmp_path, LOOP.format(line="n = np.zeros(9)"))
    assert finding.ns_per_step == lint.costs_ns()["allocate zeros"] > 0


def test_a_loop_that_does_not_step_has_no_finding(tmp_path: Path) -> None:
    results = findings(
        tmp_path,
        """
        data = mujoco.MjData(model)
        for name in names:
            log.append(data.joint(name).qpos)
        """,
    )
    assert results == []


def test_an_mjdata_is_recognised_by_its_use(tmp_path: Path) -> None:
    results = findings(
        tmp_path,
        """
        class Env:
            def step(self, u):
                for _ in range(self.skip):
                    mujoco.mj_step(self.m, self.d)
                    self.log.append(self.d.qpos)
        """,
    )
    assert [(f.line, f.code) for f in results] == [(6, "MJB001")]


def test_lines_and_columns_count_from_1(tmp_path: Path) -> None:
    (finding,) = findings(tmp_path, LOOP.format(line="log.append(data.qpos)"))
    assert (finding.line, finding.col) == (9, 16)


@pytest.mark.parametrize("text", ["def (", "\x00"])
def test_a_file_that_is_not_python_is_bad_input(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="script"):
        findings(tmp_path, text)


def test_linting_imports_no_engine() -> None:
    code = (
        "import sys, mjbench.loop.lint; sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT)
    assert done.returncode == 0


def test_codes_are_unique() -> None:
    assert len({rule.code for rule in RULES}) == len(RULES)


def test_named_files_and_the_python_files_below_folders_are_checked(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name in ("b.py", "sub/a.py", "notes.txt"):
        (tmp_path / name).touch()
    named = str(tmp_path / "notes.txt")
    files = lint.python_files([named, str(tmp_path)])
    assert files == [named, str(tmp_path / "b.py"), str(tmp_path / "sub" / "a.py")]
    with pytest.raises(InputError, match="no such file"):
        lint.python_files([str(tmp_path / "missing.py")])
