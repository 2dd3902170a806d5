"""Which named accesses leave their loop, and why others stay."""

import textwrap
from pathlib import Path

import mujoco
import pytest

from mjbench.loop import lint_fixes

SCRIPT = """\
import mujoco
from mujoco import mj_step as step
{before}
def run(model, data, n, name):
    for i in range(n):
        mujoco.mj_step(model, data)
        {line}
"""


def fixed(file: Path, text: str) -> lint_fixes.LintedFile:
    file.write_text(textwrap.dedent(text))
    return lint_fixes.fix(str(file))


def fixed_text(file: Path, text: str) -> str:
    return fixed(file, text).after.parts[0].text


def reasons(file: Path, text: str) -> list[str]:
    result = fixed(file, text)
    assert result.after.data == result.before.data
    assert result.fixed == 0
    return [each.reason for each in result.unfixed]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "script.py"


@pytest.mark.parametrize(
    ("line", "binding", "after"),
    [
        (
            "x = data.joint('hip').qpos[0]",
            "hip_joint = data.joint('hip')",
            "x = hip_joint.qpos[0]",
        ),
        (
            "data.actuator('m 1').ctrl = 0.5  # full",
            "m_1_actuator = data.actuator('m 1')",
            "m_1_actuator.ctrl = 0.5  # full",
        ),
        ("x = data.body(3).xpos", "body_3 = data.body(3)", "x = body_3.xpos"),
        ("x = data.jnt(name).qpos", "named_jnt = data.jnt(name)", "x = named_jnt.qpos"),
        ("x = data.site('ö').xpos", "named_site = data.site('ö')", "x = named_site.xpos"),
        (
            "x = data.joint('hip_joint').qpos",
            "hip_joint = data.joint('hip_joint')",
            None,
        ),
        (
            "m = model.body('torso').mass",
            "model_torso_body = model.body('torso')",
            "m = model_torso_body.mass",
        ),
        (
            "i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, 'torso')",
            "torso_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, 'torso')",
            "i = torso_id",
        ),
        ("i = mujoco.mj_name2id(model, 1, name)", None, "i = named_id"),
        ("x = 1if data.joint('hip')else 2", None, "x = 1if hip_joint else 2"),
        ("x = 1if(data).joint('hip')else 2", None, "x = 1if hip_joint else 2"),
        ("for k in range(3): x = data.body('b').xpos[k]", None, "for k in range(3): x = b_body"),
        ("while data.joint('a').qpos[0] < 1: step(model, data)", None, "while a_joint.qpos[0]"),
        ("x = data.joint('a').qpos if data.joint('a') else 0", None, "a_joint.qpos if a_joint"),
    ],
)
def test_an_access_in_every_step_is_bound_before_the_loop(
    file: Path, line: str, binding: str | None, after: str | None
) -> None:
    text = fixed_text(file, SCRIPT.format(before="", line=line))
    assert after is None or f"        {after}" in text or after in text
    assert binding is None or f"\n    {binding}\n    for i in range(n):\n" in text
    assert lint_fixes.fix(str(file)).fixed == 1 + (line.count("data.joint('a')") == 2)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("if i: data.joint('hip').qpos", "not every step reaches it"),
        ("x = i and data.joint('hip')", "not every step reaches it"),
        ("x = data.joint('hip') if i else None", "not every step reaches it"),
        ("x = 1 < i < data.joint('hip').qpos", "not every step reaches it"),
        ("assert i, data.joint('hip')", "not every step reaches it"),
        ("with suppress(KeyError): data.joint('hip')", "not every step reaches it"),
        ("for data.joint('hip').qpos[0] in (1, 2): pass", "not every step reaches it"),
        ("x = [data.joint('hip').qpos[k] for k in range(1)]", "it is in a comprehension"),
        ("print(f'{data.joint(\"hip\").qpos}')", "it is in an f-string"),
        ("x = data.joint('hip').qpos; data = other()", "the loop binds data again"),
        ("x = data.joint('hip').qpos; del data", "the loop binds data again"),
        ("x = data.joint('hip').qpos; (data := f())", "the loop binds data again"),
        ("x = data.joint('hip').qpos; import f as data", "the loop binds data again"),
        ("x = data.joint(i).qpos", "the loop binds i again"),
        ("x = data.joint(f()).qpos", "its arguments are not plain"),
        ("x = data.joint(name='hip').qpos", "its arguments are not plain"),
        ("x = data.joint(*name).qpos", "its arguments are not plain"),
        ("x = data.joint(missing).qpos", "where missing gets its value is not known"),
        ("x = self.data.joint('hip').qpos", "self.data may be another object in the next step"),
        ("x = mjdata.joint('hip').qpos", "mjdata is not certain to be an MjData"),
        ("i = mj_name2id(model, 1, 'b')", "mj_name2id is not certain to be that of mujoco"),
        ("i = mujoco.mj_name2id(self.m, 1, 'b')", "self.m may be another object"),
        ("i = mujoco.mj_name2id(model, kind(), 'b')", "its arguments are not plain"),
        ("x = (data  # of the left leg\n          .joint('hip').qpos)", "a comment stands in it"),
    ],
)
def test_what_is_not_certain_stays_and_says_why(file: Path, line: str, reason: str) -> None:
    (actual,) = reasons(file, SCRIPT.format(before="from robots import mjdata", line=line))
    assert actual.startswith(reason)


@pytest.mark.parametrize("end", ["break", "return", "raise ValueError", "continue"])
def test_no_iteration_may_end_before_an_access(file: Path, end: str) -> None:
    access = "x = data.joint('hip').qpos"
    (reason,) = reasons(file, SCRIPT.format(before="", line=f"if i: {end}\n        {access}"))
    assert reason.startswith("not every step")
    assert fixed(file, SCRIPT.format(before="", line=f"{access}\n        if i: {end}")).fixed == 1
    inner = f"for k in range(3):\n            if k: {end}\n        {access}"
    of_inner = end in ("break", "continue")
    assert fixed(file, SCRIPT.format(before="", line=inner)).fixed == of_inner
    at_end = f"for k in range(3): pass\n        else: {end}\n        {access}"
    assert fixed(file, SCRIPT.format(before="", line=at_end)).fixed == 0


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            """
            class Robot:
                data = mujoco.MjData(model)
                for i in range(9):
                    mujoco.mj_step(model, data)
                    data.joint("hip").qpos
            """,
            "a name bound in the body of a class becomes its attribute",
        ),
        (
            """
            data = mujoco.MjData(model)
            def reset():
                global data
                data = mujoco.MjData(model)
            for i in range(9):
                mujoco.mj_step(model, data)
                data.joint("hip").qpos
            """,
            "a global or nonlocal statement names data",
        ),
        (
            """
            data = mujoco.MjData(model)
            for i in range(9):
                mujoco.mj_step(model, data)
                data.joint("hip").qpos
                exec(code)
            """,
            "exec, setattr, globals or the like could reach data",
        ),
        (
            """
            for episode in range(3):
                data = mujoco.MjData(model)
                for _ in steps():
                    print(data.time)
            def steps():
                for i in range(9):
                    mujoco.mj_step(model, data)
                    yield data.joint("hip").qpos
            """,
            "data belongs to another scope, which may bind it again",
        ),
        (
            """
            data = robot.data
            for i in range(9):
                env.step(action)
                data.joint("hip").qpos
            """,
            "data is not certain to be an MjData or an MjModel of mujoco",
        ),
        (
            """
            def run(model, n):
                data = mujoco.MjData(model)
                for i in range(n):
                    mujoco.mj_step(model, data)
                    data.joint("hip").qpos
                return dir()
            """,
            "exec, setattr, globals or the like could reach data",
        ),
        (
            """
            def run(model, n):
                data = mujoco.MjData(model) if model else None
                for i in range(n):
                    mujoco.mj_step(model, data)
                    data.joint("hip").qpos
            """,
            "data may have no value before the loop",
        ),
        (
            """
            class Twin(mujoco.MjData):
                def joint(self, name): return super().joint(self.names[name])
            data = Twin(model)
            for i in range(9):
                mujoco.mj_step(model, data)
                data.joint("hip").qpos
            """,
            "data is not certain to be an MjData or an MjModel of mujoco",
        ),
    ],
)
def test_names_that_others_may_bind_again_stay(file: Path, text: str, reason: str) -> None:
    assert reasons(file, "import mujoco\n" + textwrap.dedent(text)) == [reason]


def test_an_engine_that_is_not_imported_is_not_known(file: Path) -> None:
    loop = "for i in range(9):\n    mujoco.mj_step(model, data)\n    data.joint('hip').qpos\n"
    for before in ("data = mujoco.MjData(model)", "import mujoco\nmujoco = data = wrapped(mujoco)"):
        (reason,) = reasons(file, f"{before}\n{loop}")
        assert reason.startswith("data is not certain")


def test_one_access_in_every_step_serves_those_in_some(file: Path) -> None:
    text = SCRIPT.format(
        before="", line="if i: print(data.joint('a').qpos)\n        x = data.joint( 'a' ).qvel"
    )
    changed = fixed_text(file, text)
    assert changed.count("data.joint") == 1
    assert "print(a_joint.qpos)" in changed
    assert "    a_joint = data.joint('a')\n" in changed  # as the first is spelled


def test_an_access_leaves_all_loops_that_step_but_no_function(file: Path) -> None:
    text = """
    import mujoco
    for episode in range(3):
        mujoco.mj_step(model, data)
        def run(model, data):
            for i in range(3):
                mujoco.mj_step(model, data)
                while data.time < 1:
                    mujoco.mj_step(model, data)
                    print(data.body("b").xpos)
    """
    changed = fixed_text(file, text)
    assert '        b_body = data.body("b")\n        for i in range(3):\n' in changed
    assert changed.count("data.body") == 1


def test_an_access_stays_in_a_loop_that_makes_the_mjdata(file: Path) -> None:
    text = """
    import mujoco
    for episode in range(3):
        data = mujoco.MjData(model)
        for i in range(9):
            mujoco.mj_step(model, data)
            data.joint("hip").qpos
            data.joint("hip").qpos
    """
    assert '    hip_joint = data.joint("hip")\n    for i in range(9):\n' in fixed_text(file, text)


def test_a_new_name_is_no_word_of_the_script(file: Path) -> None:
    text = SCRIPT.format(before="import hip_joint\nself.hip_joint_2 = 1", line="data.joint('hip')")
    assert "hip_joint_3 = data.joint('hip')" in fixed_text(file, text)


def test_loops_with_the_same_access_bind_the_same_name(file: Path) -> None:
    loop = "    for i in range(n):\n        mujoco.mj_step(model, data)\n        data.joint('a')\n"
    changed = fixed_text(file, f"import mujoco\ndef run(model, data, n):\n{loop}{loop}")
    assert changed.count("a_joint = data.joint('a')\n    for") == 2


def test_a_view_behind_a_hoisted_access_is_still_seen(file: Path) -> None:
    text = SCRIPT.format(before="", line="log.append(data.joint('hip').qpos)")
    text = text.replace("    for", "    log = []\n    for")
    assert "log.append(hip_joint.qpos.copy())" in fixed_text(file, text)
    file.write_text(text)
    result = lint_fixes.fix(str(file), ["MJB002"])
    file.write_bytes(result.after.data)
    assert [finding.code for finding in lint_fixes.fix(str(file)).before and result.findings] == []
    assert lint_fixes.fix(str(file), ["MJB001"]).fixed == 1


def test_accesses_of_mujoco_are_the_same_object_as_long_as_the_mjdata_lives() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="b"><joint name="j" axis="0 1 0"/>
        <geom name="g" size="1" pos="1 0 0"/></body></worldbody>
        <sensor><jointpos name="s" joint="j"/></sensor></mujoco>"""
    )
    data = mujoco.MjData(model)
    elements = (("joint", "j"), ("body", "b"), ("geom", "g"), ("sensor", "s"))
    accessors = [getattr(data, kind)(name) for kind, name in elements]
    body = model.body("b")
    before = data.joint("j").qpos.copy()
    mujoco.mj_step(model, data, nstep=9)
    assert accessors[0].qpos == data.qpos != before
    assert accessors[3].data == data.sensordata
    mujoco.mj_resetData(model, data)
    assert accessors[0].qpos == before
    assert [getattr(data, kind)(name) for kind, name in elements] == accessors
    assert all(
        getattr(data, kind)(name) is accessor
        for (kind, name), accessor in zip(elements, accessors, strict=True)
    )
    assert model.body("b") is body
