"""Whatever a script does, `--fix` leaves it computing the same, and a second one finds no more."""

import contextlib
import json
import re
import textwrap
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from mjbench.loop import lint, lint_fixes

# Without a time limit; the same examples in every run, so that a release is never held up by luck.
thorough = settings(deadline=None, max_examples=150, derandomize=True)

XML = """<mujoco><worldbody><body name="b"><joint name="j" axis="0 1 0" damping=".1"/>
<geom name="g" size=".1" pos="1 0 0"/><body name="j2" pos="1 0 0"><joint name="j2"/>
<geom size=".1"/></body></body></worldbody><actuator><motor name="m" joint="j"/></actuator>
<sensor><jointpos name="s" joint="j2"/></sensor></mujoco>"""
MAX_TICKS = 300
PREAMBLE = """# coding: utf-8
import contextlib

import mujoco

model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
name = "j"
"""
ACCESSES = {
    "data.joint('j')": ".qpos[0]",
    "data.joint( name )": ".qvel[0]",
    'data.body("b")': ".xpos[2]",
    "data.geom(0)": ".xmat[1]",
    "data.sensor('s')": ".data[0]",
    "data.actuator('m')": ".ctrl[0]",
    "model.body('j2')": ".mass[0]",
    "mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, 'j2')": "",
    "(data).joint('j2')": ".qpos[0]",
}
values = st.sampled_from([access + value for access, value in ACCESSES.items()])
# Statements in which V is a value and S a block. Loops run at least once, and wrong names are only
# where nothing comes to pass: there --fix may raise earlier than the script.
STATEMENTS = (
    *("mujoco.mj_step(model, data)",) * 3,
    *(
        "log.append(V)  # ö: V",
        "log.append( (V,V) );x=V  ;  log.append(x)",
        "log.append(f'''{V:.9f}''')",
    ),
    *("if next(ticks) % 2:\nS", "if V > 0.01:\nS\nelse:\nS", "for k in range(2):\nS", "'''V\n'''"),
    *("while next(ticks) % 3:\nS", "for k in [V]:\nS\nelse:\nS", "while V > next(ticks):\nS"),
    *("data = mujoco.MjData(model)", "model.body('b').mass = 1 + next(ticks) / 100"),
    *("name = 'j2' if name == 'j' else 'j'", "mujoco.mj_resetData(model, data)"),
    *("try:\nS\nfinally:\nS", "with contextlib.nullcontext():\nS", "data.joint('j').qvel = [V]"),
    *("log.append([V for k in range(2)])", "log.append(V if V > 0 else 2 if V else V)"),
    *("if next(ticks) % 5 == 4: continue", "if next(ticks) % 5 == 4: break", "data.ctrl[0] = V"),
    *("if len(log) < 0: data.joint('missing').qpos", "assert next(ticks) >= 0 or V"),
    *("def reset():\n  global data\n  data = mujoco.MjData(model)\nreset()", "x = lambda: V"),
    *("[x] = [V]\nlog.append(\n  x+\\\n  V)", "log.append(data.qpos.copy())", "y = V and V or V"),
)


@st.composite
def filled(draw: st.DrawFn, template: str, block: str) -> str:
    """Draw the values of a statement."""
    text = re.sub(r"\bV\b", lambda _: draw(values), template)
    return re.sub(r"^S$", lambda _: textwrap.indent(block, "  "), text, flags=re.MULTILINE)


def statement(smaller: SearchStrategy[str]) -> SearchStrategy[str]:
    blocks = st.lists(smaller, min_size=1, max_size=3).map("\n".join)
    return st.tuples(st.sampled_from(STATEMENTS), blocks).flatmap(lambda both: filled(*both))


statements = st.recursive(
    st.sampled_from(["mujoco.mj_step(model, data)", "pass"]), statement, max_leaves=10
)


@st.composite
def scripts(draw: st.DrawFn) -> str:
    """Draw a script with a loop, of the module or of a function."""
    body = "\n".join(draw(st.lists(statements, min_size=1, max_size=5)))
    step = draw(st.sampled_from(["mujoco.mj_step(model, data)\n", ""]))
    loop = "for i in range(4):\n" + textwrap.indent(step + body, "  ") + "\n"
    if draw(st.booleans()):
        function = "def run(model, data, name):\n" + textwrap.indent(loop, "\t")
        return PREAMBLE + function.replace("global", "nonlocal") + "run(model, data, name)\n"
    return PREAMBLE + loop


def outcome(text: str) -> tuple[list[Any], str, int]:
    """Return what a script logs, with the state at its end, the error that ends it, its ticks."""
    log: list[Any] = []
    ticks = iter(range(MAX_TICKS))  # where a loop would never end, it raises StopIteration
    names = {"XML": XML, "log": log, "ticks": ticks}
    error = ""
    try:
        exec(compile(text, "script", "exec"), names)
    except Exception as raised:
        error = repr(raised)
    with contextlib.suppress(KeyError):
        log.append(names["data"].qpos)
    return json.loads(json.dumps(log, default=list)), error, next(ticks, MAX_TICKS)


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scripts") / "script.py"


def undone(text: str, before: str) -> str:
    """Return a fixed script without its new lines, and with the accesses that they hold."""
    lines = text.splitlines(keepends=True)
    known = set(re.findall(r"\w+", before))
    bindings = {}
    for line in list(lines):
        match = re.fullmatch(r"\s*(?P<name>\w+) = (?P<access>.*)\s*", line)
        if match and match["name"] not in known:
            bindings[match["name"]] = match["access"]
            lines.remove(line)
    return re.sub(r"\w+", lambda word: bindings.get(word[0], word[0]), "".join(lines))


@thorough
@given(text=scripts())
def test_a_fixed_script_computes_the_same_and_stays_as_it_is(script: Path, text: str) -> None:
    script.write_text(text, encoding="utf-8")
    result = lint_fixes.fix(str(script))
    after = result.after.parts[0].text
    assert outcome(after) == outcome(text)
    assert undone(after, text) == text
    left = [finding for finding in result.findings if finding.code == "MJB002"]
    assert [each.finding for each in result.unfixed] == left
    result.write()
    again = lint_fixes.fix(str(script))
    assert (again.fixed, again.after.data) == (0, result.after.data)
    assert again.findings == result.findings == lint.check(str(script))


def test_many_generated_scripts_are_fixed(script: Path) -> None:
    fixed, left = [], []

    @settings(thorough, max_examples=60)
    @given(text=scripts())
    def collect(text: str) -> None:
        script.write_text(text, encoding="utf-8")
        result = lint_fixes.fix(str(script))
        fixed.append(result.fixed)
        left.extend(each.reason for each in result.unfixed)

    collect()
    assert sum(map(bool, fixed)) >= 10
    assert len(set(left)) >= 4
