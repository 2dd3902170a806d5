"""What lint finds in a script, and what it must leave alone."""

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import ROOT
from linted import check

from mjbench.commands.lint import check as lint
from mjbench.commands.lint.rules import COSTS_NS, RULES
from mjbench.commands.lint.script_files import UncheckedFile
from mjbench.commands.lint.settings import RuleChoice
from mjbench.commands.profile import habits
from mjbench.errors import InputError

LOOP = """
import mujoco
import numpy as np

data = mujoco.MjData(model)
hinge = data.joint("hinge")
log, rows, table = [], {{}}, np.empty((100, model.nq))
for i in range(100):
    mujoco.mj_step(model, data)
    {line}
"""


def codes(line: str) -> list[str]:
    return [f.code for f in check(LOOP.format(line=line))]


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
        ("m = model.body('box').mass", "MJB002"),
        ("x = data.jnt('hinge').qvel", "MJB002"),
        ("log.append(hinge.qpos)", "MJB001"),
        ("state = np.concatenate([data.qpos, data.qvel])", "MJB003"),
        ("u = np.zeros(model.nu)", "MJB003"),
    ],
)
def test_each_rule_finds_its_pattern(line: str, code: str) -> None:
    assert codes(line) == [code]


@pytest.mark.parametrize(
    "line",
    [
        "log.append(data.qpos.copy())",
        "log.append(np.array(data.qpos))",
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
        "log.append(hinge.qpos[0])",
        "log.append(hinge.qpos.copy())",
        "log.append((hinge.id, hinge.name))",
        "x = policy.body('box')",
        "x = np.add(data.qpos, data.qpos)",
        "data.ctrl = data.qpos",
        "self.last = data.qpos.copy()",
        "if i == 12: u = np.zeros(model.nu)",
        "rows = np.zeros(data.nefc)",
        "depths = np.array(data.contact.dist)",
    ],
)
def test_correct_code_has_no_finding(line: str) -> None:
    assert codes(line) == []


def test_noqa_for_another_rule_suppresses_nothing() -> None:
    assert codes("log.append(data.qpos)  # noqa: MJB002, E501") == ["MJB001"]


def test_a_comprehension_that_steps_is_a_loop() -> None:
    results = check(
        """
        def advance():
            mj_step(model, data)
            return True
        log = [data.qpos for _ in range(9) if advance()]
        """,
    )
    assert [f.code for f in results] == ["MJB001"]


def test_a_new_mjdata_per_episode_and_serial_simulations_are_found() -> None:
    results = check(
        """
        for episode in range(10):
            data = mujoco.MjData(model)
            for i in range(100):
                mujoco.mj_step(model, data)
        """,
    )
    assert [f.code for f in results] == ["MJB006", "MJB005", "MJB017"]


def test_a_loop_that_resets_at_times_is_none_over_simulations() -> None:
    text = """
        for call in range(30):
            if call == 12:
                mujoco.mj_resetData(model, data)
            for _ in range(hold):
                mujoco.mj_step(model, data)
        """
    assert [f.code for f in check(text)] == ["MJB017"]


def test_what_runs_once_per_episode_does_not_run_in_every_step() -> None:
    results = check(
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


def test_a_new_mjdata_of_a_new_model_is_not_found() -> None:
    results = check(
        """
        for mass in masses:
            model = mujoco.MjModel.from_xml_string(xml)
            data = mujoco.MjData(model)
            for i in range(100):
                mujoco.mj_step(model, data)
        """,
    )
    assert [f.code for f in results] == ["MJB006", "MJB011", "MJB017"]


STEP = "mujoco.mj_step(model, data)"


@pytest.mark.parametrize(
    "lines",
    [
        f"for _ in range(frame_skip): {STEP}",
        f"for i in range(9):\n    data.ctrl[:] = policy(data)\n    for _ in range(5): {STEP}",
        f"while viewer.is_running():\n    for k in range(2, 9): {STEP}\n    viewer.sync()",
        "for _ in range(9): mujoco.mj_step(self.model, self.data)",
    ],
)
def test_steps_with_nothing_between_them_are_found(lines: str) -> None:
    (finding,) = check(lines)
    assert (finding.code, finding.is_wrong_result) == ("MJB017", False)


@pytest.mark.parametrize(
    "lines",
    [
        f"for _ in range(9):\n    {STEP}\n    data.ctrl[:] = policy(data)",
        f"for _ in range(9):\n    data.ctrl[:] = 0\n    {STEP}",
        "for data in datas: mujoco.mj_step(model, data)",
        "for i in range(9): mujoco.mj_step(model, datas[i])",
        f"for ctrl in plan: {STEP}",
        f"while data.time < 1: {STEP}",
        "for _ in range(9): mujoco.mj_step(model, controlled(data))",
        "for _ in range(9): mujoco.mj_step(model, data, 5)",
        "for _ in range(9): mujoco.mj_step1(model, data)",
        f"for _ in range(9): {STEP}\nelse: print(1)",
        STEP,
    ],
)
def test_steps_with_something_between_them_are_not(lines: str) -> None:
    assert "MJB017" not in [f.code for f in check(lines)]


def test_an_annotated_mjdata_is_one() -> None:
    text = LOOP.format(line="x = sim.joint('hinge').qpos[0]")
    annotated = text.replace("log, rows", "sim: mujoco.MjData = mujoco.MjData(model)\nlog, rows")
    assert [f.code for f in check(annotated)] == ["MJB002"]


def test_costs_come_from_the_stored_table() -> None:
    (row,) = json.loads((ROOT / "results" / "overhead.json").read_text())["results"]
    stored = {cost["source"]: cost["ns"] for cost in row["costs"]}
    assert {habit: stored[habit] for habit in COSTS_NS} == COSTS_NS
    assert COSTS_NS.keys() <= {habit.name for habit in habits.HABITS}
    (finding,) = check(LOOP.format(line="n = np.concatenate([data.qpos, data.qvel])"))
    assert finding.ns_per_step == COSTS_NS["concatenate"]
    (finding,) = check(LOOP.format(line="n = np.zeros(9)"))
    assert finding.ns_per_step == COSTS_NS["allocate zeros"]


def test_a_loop_that_does_not_step_has_no_finding() -> None:
    results = check(
        """
        data = mujoco.MjData(model)
        for name in names:
            log.append(data.joint(name).qpos)
        """,
    )
    assert results == []


def test_what_a_loop_does_at_its_end_runs_once() -> None:
    results = check(
        """
        for i in range(9):
            mujoco.mj_step(model, data)
        else:
            data.joint("hinge").qpos
            mujoco.mj_step(model, data)
        """,
    )
    assert results == []


def test_a_name_for_more_than_a_named_part_is_no_view() -> None:
    text = LOOP.format(line="log.append(part.qpos)")
    assert check(f"part = data.joint('a')\npart = robot.state()\n{text}") == []


def test_an_mjdata_is_recognised_by_its_use() -> None:
    results = check(
        """
        class Env:
            def step(self, u):
                for _ in range(self.skip):
                    mujoco.mj_step(self.m, self.d)
                    self.log.append(self.d.qpos)
        """,
    )
    assert [(f.line, f.code) for f in results] == [(6, "MJB001")]


@pytest.mark.parametrize(
    ("setup", "step", "stored"),
    [
        ("env = gym.make('Ant-v5')", "env.step(a)", "log.append(env.unwrapped.data.qpos)"),
        ("robot = gymnasium.make('Ant-v5')", "robot.step(a)", "log.append(robot.data.qpos)"),
        ("world = suite.load('walker', 'run')", "world.step(a)", "log.append(world.data.qvel)"),
        ("robot = AntEnv()", "robot.step(a)", "rows[k] = robot.data.xpos[1]"),
        ("", "self.env.step(a)", "log.append(self.env.unwrapped.data.qpos[:2])"),
        ("", "physics.step()", "log.append(physics.data.qpos)"),
        ("", "self.do_simulation(a, 5)", "self.last = self.data.qpos"),
    ],
)
def test_a_view_stored_beside_an_environments_steps_is_found(
    setup: str, step: str, stored: str
) -> None:
    text = f"rows = {{}}\n{setup}\nfor k in range(9):\n    {step}\n    {stored}\n"
    (finding,) = check(text)
    assert (finding.line, finding.code) == (5, "MJB001")
    copied = text.replace(stored, f"{stored.removesuffix(')')}.copy()" + ")" * stored.endswith(")"))
    assert check(copied) == []


def test_a_method_that_steps_runs_in_somebodys_loop() -> None:
    results = check(
        """
        class Ant(MujocoEnv):
            def step(self, action):
                before = self.data.qpos[:2]
                self.do_simulation(action, self.frame_skip)
                self.log.append(self.data.qpos)
                self.last = self.data.qvel
                seen = []
                seen.append(self.data.qpos)
                return before

            def reset(self):
                self.start = self.data.qpos
        """,
    )
    assert [(f.line, f.code) for f in results] == [(6, "MJB001"), (7, "MJB001")]


def test_an_element_of_a_named_view_is_a_number() -> None:
    results = check(
        """
        class Box(SawyerEnv):
            def reset_model(self):
                mujoco.mj_step(self.model, self.data)
                self.height = self.data.geom("box").xpos[2]
                self.init_corner = self.data.geom("box").xpos[:2]
        """,
    )
    assert [(f.line, f.code) for f in results] == [(6, "MJB001")]


@pytest.mark.parametrize("step", ["optimizer.step()", "scheduler.step()", "self.model.step(x)"])
def test_other_steps_are_not_those_of_an_environment(step: str) -> None:
    text = f"for k in range(9):\n    {step}\n    log.append(self.data.qpos)\n"
    assert check(text) == []


def test_an_environments_loop_may_allocate() -> None:
    text = "for k in range(9):\n    env.step(np.zeros(3))\n    env.data.joint('x').qpos\n"
    assert [f.code for f in check(text)] == ["MJB002"]


def test_lines_and_columns_count_from_1() -> None:
    (finding,) = check(LOOP.format(line="log.append(data.qpos)"))
    assert (finding.line, finding.col) == (10, 16)


@pytest.mark.parametrize("text", ["def (", "\x00"])
def test_a_file_that_is_not_python_is_bad_input(text: str) -> None:
    with pytest.raises(InputError, match="script"):
        check(text)


def test_linting_imports_no_engine() -> None:
    code = (
        "import sys, mjbench.commands.lint.check;"
        " sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT)
    assert done.returncode == 0


def test_codes_are_unique_and_each_rule_is_explained() -> None:
    assert len({rule.code for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert "\nResults" in rule.explanation, rule.code
        assert "\n\n    " in rule.explanation, rule.code  # an example
        assert all(len(line) <= 100 for line in rule.explanation.splitlines()), rule.code


def test_rules_are_explained_where_python_drops_docstrings() -> None:
    code = (
        "from mjbench.commands.lint.check import RULES;"
        " print(*(rule.explanation for rule in RULES))"
    )
    command = [sys.executable, "-OO", "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == " ".join(rule.explanation for rule in RULES).strip(), done.stderr


def test_a_loop_steps_through_functions_that_call_each_other() -> None:
    results = check(
        """
        def advance(data):
            mujoco.mj_step(model, data)
        def episode():
            advance(data)
        for i in range(9):
            episode()
            log.append(data.qpos)
        """,
    )
    assert [(f.line, f.code) for f in results] == [(8, "MJB001")]


def test_wrong_results_are_told_from_lost_time() -> None:
    stored, access = check(LOOP.format(line="log.append(data.qpos); data.joint('hinge').qpos"))
    assert (stored.is_wrong_result, access.is_wrong_result) == (True, False)
    assert stored.instead == ()


DEPTH = 100_000


@pytest.mark.parametrize(
    "text",
    [
        "-" * DEPTH + "1",
        "not " * DEPTH + "x",
        "1" + " + 1" * DEPTH,
        "(" * DEPTH + ")" * DEPTH,
        "x" + ".y" * DEPTH,
        "x" + "()" * DEPTH,
        "lambda: " * DEPTH + "1",
        "if x: pass\n" + "elif x: pass\n" * DEPTH,
        LOOP.format(line="log.append(data.qpos" + ".T" * 2000 + ")"),
    ],
    ids=["-", "not", "+", "()", ".", "call", "lambda", "elif", "view"],
)
def test_what_is_nested_too_deeply_is_bad_input(text: str) -> None:
    with pytest.raises(InputError, match=r"script\.py: .*(nested|too many)"):
        check(text)


def test_long_sums_and_chains_are_checked() -> None:
    text = LOOP.format(line="log.append(data.qpos)")  # Python's own recursion limit is 1000
    text += f"x = [1]{' + [1]' * 1500}\ny = x{'.y' * 1500}\nx[0], z = y, x{'.y' * 1500}()\n"
    assert [f.code for f in check(text)] == ["MJB001"]


def test_columns_count_characters() -> None:
    (finding,) = check(LOOP.format(line="'é𝔁'; log.append(data.qpos)"))
    assert (finding.line, finding.col) == (10, 22)


def test_a_coroutine_is_a_function_like_others() -> None:
    results = check(
        """
        async def advance():
            mujoco.mj_step(model, data)
        async def run():
            for i in range(9):
                await advance()
                log.append(data.qpos)
                async def later():
                    log.append(data.qvel)
        """,
    )
    assert [(f.line, f.code) for f in results] == [(7, "MJB001")]


@pytest.mark.parametrize(
    "text", ["str(log)", "repr(log)", "format(log)", "f'{log}'", "'%s' % log", "'{}'.format(log)"]
)
def test_a_copy_into_a_log_changes_the_simulation_that_its_text_feeds(text: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(ROOT / "models/cartpole.xml"))

    def last_state(view: str) -> np.ndarray:
        script = LOOP.replace('hinge = data.joint("hinge")\n', "").format(
            line=f"log.append({view}); data.ctrl[0] = 0.01 * len({text})"
        )
        assert [f.code for f in check(script)] == ([] if view.endswith("copy()") else ["MJB001"])
        names = {"model": model}
        exec(script, names)
        return names["data"].qpos

    assert not np.array_equal(last_state("data.qpos"), last_state("data.qpos.copy()"))
    rule = next(rule for rule in RULES if rule.code == "MJB001")
    assert "unless the program steps from what it reads" in " ".join(rule.explanation.split())


def test_a_file_that_cannot_be_checked_stands_between_the_findings_of_others(
    tmp_path: Path,
) -> None:
    (tmp_path / "a.py").write_text(LOOP.format(line="log.append(data.qpos)"))
    (tmp_path / "b.py").write_text("def (")
    (tmp_path / "c.py").write_text("-" * DEPTH + "1")
    (tmp_path / "d.py").write_text(LOOP.format(line="x = np.zeros(3)"))
    names = [str(tmp_path / name) for name in ("a.py", "b.py", "missing.py", "c.py", "d.py")]
    folder = UncheckedFile("folder", "cannot be listed")
    results = list(lint.check_all([*names, folder], RuleChoice()))
    first = [r if isinstance(r, UncheckedFile) else r[0] for r in results]
    assert [each.file for each in first] == [*names, "folder"]
    codes = [r.detail if isinstance(r, UncheckedFile) else r.code for r in first]
    assert codes == [
        "MJB001",
        "line 1: invalid syntax",
        "no such file",
        "nested too deeply, or too large, for Python's parser or for lint",
        "MJB003",
        "cannot be listed",
    ]
