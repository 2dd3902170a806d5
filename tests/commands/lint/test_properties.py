"""Whatever a file holds, lint ends in findings inside it or in an InputError."""

import re
import sys
import textwrap
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from mjbench.commands.lint import check as lint
from mjbench.errors import InputError

# Without a time limit; the same examples in every run, so that a release is never held up by luck.
quick = settings(deadline=None, max_examples=60, derandomize=True)

FRAGMENTS = (
    *"()[]{}:;,.=%!?#\\'\"\n\r\t \x0c\x00é𝔁0x",
    *("'''", '"""', "\r\n", "    ", "f'{", "mj_step(model, data)", "for i in x:\n  ", "data.qpos"),
    *("log.append(", "lambda ", "async ", "# noqa", "# coding: latin-1\n", "%%time\n", "\ufeff"),
)
texts = st.lists(st.sampled_from(FRAGMENTS), max_size=30).map("".join) | st.text()

LEAVES = (
    *("x", "1", "...", "'é'", "data", "self.d", "data.qpos", "data.xpos[2]", "data.contact", "[]"),
    *("mujoco.mj_step(model, data)", "mujoco.mj_step(*arguments)", "advance()", "np.zeros(3)"),
    *("data.joint('a').qpos", "mj_name2id(m, 1, 'b')", "mujoco.MjData(model)", "{}", "data.ctrl"),
    *("copy.copy(data)", "mujoco.Renderer(model)", "jax.jit(lambda d: d)(x)", "look(data)"),
    *("mujoco.mj_forward(model, data)", "rollout.rollout(model, [x, x], x)", "[*look(data)]"),
    *("pool.submit(advance, data)", "MjModel.from_xml_string(x)", "mj_step2(model, data)"),
)
# Expressions in which A, B and C are replaced by smaller ones.
EXPRESSIONS = (
    *(
        "(A).T",
        "(A).qpos",
        "(A)[B]",
        "(A)[B:, C]",
        "(A)[:]",
        "A",
        "A + B",
        "-A",
        "not A",
        "A < B < C",
    ),
    *("A and B", "A if B else C", "(w := A)", "[*A, B]", "(A, B)", "{**A, 'k': B}", "{A, B}"),
    *(
        "f(A, *B, k=C, **A)",
        "log.append(A)",
        "log.append({'q': A})",
        "np.append(A, B)",
        "dict(a=A)",
    ),
    *("[A for i in B if C]", "(A async for i, *j in B)", "{A: B for i in C}", "np.asarray(A)"),
    *(
        "lambda *a, k=A, **b: B",
        "await A",
        "(yield A)",
        "(yield from A)",
        "(A).reshape(B)",
        "len(A)",
    ),
)
TARGETS = ("x", "rows[A]", "self.last", "(*a, (b, c.d))", "data.ctrl[:]", "(A).e", "(A)[B]", "log")
# Statements in which A, B and C are expressions, LHS is a target, and S a block.
STATEMENTS = (
    *("LHS = A", "x, log = A, B", "x: int = A", "self.y: A", "x += A", "A", "return A", "del x"),
    *("assert A, B", "global x", "raise A from B", "import a.b as c", "pass"),
    *("for LHS in A:\nS\nelse:\nS", "while A:\nS\nelse:\nS", "if A:\nS\nelif B:\nS\nelse:\nS"),
    *(
        "with A as LHS, B:\nS",
        "try:\nS\nexcept A:\nS\nelse:\nS\nfinally:\nS",
        "try:\nS\nexcept* A:\nS",
    ),
    *("match A:\n  case {'k': [x, *y], **z} if B:\n    pass\n  case C_(a=1) | None as d:\n    x",),
    *("@A\nasync def advance(x, /, y=B, *, z: C = 1) -> A:\nS", "class C_(A, k=B):\nS"),
    *("async for LHS in A:\nS", "async with A as LHS:\nS", "def f(*a: A, **b):\nS"),
)
if sys.version_info >= (3, 12):
    STATEMENTS += ("def f[Q: int, *R, **P](x: Q):\nS", "class D[Q]:\nS", "type X[Q] = A")


@st.composite
def filled(draw: st.DrawFn, template: str, expressions: SearchStrategy[str], block: str) -> str:
    """Draw what stands for the capital letters of a template."""
    template = re.sub(r"\bLHS\b", lambda _: draw(st.sampled_from(TARGETS)), template)
    text = re.sub(r"\b[ABC]\b", lambda _: f"({draw(expressions)})", template)
    return re.sub(r"^S$", lambda _: textwrap.indent(block, "  "), text, flags=re.MULTILINE)


def expression(smaller: SearchStrategy[str]) -> SearchStrategy[str]:
    return st.sampled_from(EXPRESSIONS).flatmap(lambda t: filled(t, smaller, ""))


expressions = st.recursive(st.sampled_from(LEAVES), expression, max_leaves=6)


def statement(smaller: SearchStrategy[str]) -> SearchStrategy[str]:
    blocks = st.lists(smaller, min_size=1, max_size=3).map("\n".join)
    return st.tuples(st.sampled_from(STATEMENTS), blocks).flatmap(
        lambda both: filled(both[0], expressions, both[1])
    )


statements = st.recursive(
    st.sampled_from(("mj_step(model, data)", "log.append(data.qpos)")), statement, max_leaves=8
)
PREAMBLE = "data = mujoco.MjData(model)\nlog, rows = [], {}\ndef advance():\n  mj_step(m, self.d)\n"
programs = st.lists(statements, min_size=1, max_size=4).map(
    lambda body: PREAMBLE + "for i in range(9):\n" + textwrap.indent("\n".join(body), "  ")
)


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scripts") / "script.py"


def check_places(file: Path, text: str) -> list[lint.Finding]:
    """Return the findings of a file; each must be inside its text."""
    findings = lint.check(str(file))
    for finding in findings:
        lines = re.split(r"\r\n|\r|\n", text)
        assert 1 <= finding.line <= len(lines)
        assert 1 <= finding.col <= len(lines[finding.line - 1]) + 1
    return findings


@quick
@given(data=st.binary() | texts.map(lambda text: text.encode(errors="surrogatepass")))
def test_any_file_has_findings_or_is_refused(script: Path, data: bytes) -> None:
    script.write_bytes(data)
    try:
        lint.check(str(script))
    except InputError as error:
        assert str(error).startswith(f"{script}: ")
        assert "\n" not in str(error)


@quick
@given(text=programs)
def test_any_program_is_checked_and_findings_are_inside_it(script: Path, text: str) -> None:
    script.write_text(text, encoding="utf-8")
    check_places(script, text)


def test_programs_have_findings_of_most_rules(script: Path) -> None:
    codes = set()

    @quick
    @given(text=programs)
    def collect(text: str) -> None:
        script.write_text(text, encoding="utf-8")
        codes.update(finding.code for finding in lint.check(str(script)))

    collect()
    assert len(codes) >= 4
