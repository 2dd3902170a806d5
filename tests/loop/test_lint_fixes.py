"""What `--fix` changes in a script, and what it leaves as it is."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.loop import lint, lint_fixes
from mjbench.loop.lint_rules import NAMED_ACCESS, STORED_VIEW
from mjbench.loop.script_files import UncheckedFile

LOOP = "for i in range(9):\n    mj_step(model, data)\n    {line}\n"
# What makes `log.append(data.qpos)` in the loop a log that can be corrected.
LOG = "import numpy as np\nfrom mujoco import MjData, mj_step\nlog, data = [], MjData(model)\n"
# A loop out of which `data.joint('a')` can be hoisted.
ACCESS = """\
from mujoco import MjData, mj_step
data = MjData(model)
for i in range(9):
    mj_step(model, data)
    print(data.joint('a').qpos)
"""


def fixed(file: Path, content: bytes) -> bytes:
    file.write_bytes(content)
    lint_fixes.fix(str(file)).write()
    return file.read_bytes()


@pytest.mark.parametrize(
    ("line", "after"),
    [
        ("log.append(data.qpos)", "log.append(data.qpos.copy())"),
        ("log.append((data.qpos))", "log.append((data.qpos.copy()))"),
        ("log.append((data.qpos, data.qvel))", "log.append((data.qpos.copy(), data.qvel.copy()))"),
        ("log.append({'q': data.qpos[:3]})  # ö", "log.append({'q': data.qpos[:3].copy()})  # ö"),
        ("log.append('ö'); log.append(data.qpos)", "log.append('ö'); log.append(data.qpos.copy())"),
        ("log.append(np.asarray(data.qpos))", "log.append(np.asarray(data.qpos).copy())"),
        ("log.append(\n        data.qpos\n    )", "log.append(\n        data.qpos.copy()\n    )"),
        ("log.append(data.qpos)  # noqa: MJB001", "log.append(data.qpos)  # noqa: MJB001"),
        ("u = np.zeros(3)", "u = np.zeros(3)"),
    ],
)
def test_a_stored_view_gets_a_copy_and_nothing_else_changes(
    tmp_path: Path, line: str, after: str
) -> None:
    text, expected = LOG + LOOP.format(line=line), LOG + LOOP.format(line=after)
    assert fixed(tmp_path / "script.py", text.encode()).decode() == expected
    remaining = lint.check(str(tmp_path / "script.py"))
    assert all(finding.code != STORED_VIEW for finding in remaining)


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_encoding_and_line_ends_stay(tmp_path: Path, end: str, encoding: str) -> None:
    loop = LOOP.format(line="log.append(data.qpos)")
    declared = f"# coding: {encoding}\nname = 'ö'\n{LOG}{loop}"
    content = declared.replace("\n", end).encode(encoding)
    expected = content.replace(b"data.qpos)", b"data.qpos.copy())")
    assert fixed(tmp_path / "script.py", content) == expected


def test_new_lines_end_as_those_of_their_loop(tmp_path: Path) -> None:
    content = ACCESS.replace("\n", "\r\n").encode()
    after = fixed(tmp_path / "script.py", content)
    assert after.count(b"\r\n") == after.count(b"\n") == content.count(b"\n") + 1
    assert b"\r\na_joint = data.joint('a')\r\nfor" in after
    one_line = b"from mujoco import *\r\n" + b"import mujoco\rdata = mujoco.MjData(m)\n"
    one_line += b"for i in range(9): mujoco.mj_step(m, data); data.joint('a')"
    assert fixed(tmp_path / "script.py", one_line).endswith(
        b"\na_joint = data.joint('a')\nfor i in range(9): mujoco.mj_step(m, data); a_joint"
    )


def test_a_call_on_several_lines_becomes_one(tmp_path: Path) -> None:
    call = "mujoco.mj_name2id(\n        model,\n        1, 'é',\n    )"
    text = "import mujoco\nmodel = load()\n" + LOOP.format(line=f"x[{call}] = 1")
    after = fixed(tmp_path / "script.py", text.encode()).decode()
    assert after == text.replace(call, "named_id").replace(
        "for", "named_id = mujoco.mj_name2id(model, 1, 'é')\nfor"
    )


def test_what_cannot_be_changed_safely_stays_and_says_why(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    call = "mujoco.mj_name2id(\n        model, 1, '\\xe9')"
    text = "# coding: ascii\nimport mujoco\nmodel = 1\n" + LOOP.format(line=f"x = {call}")
    file.write_text(text)
    result = lint_fixes.fix(str(file))
    assert (result.fixed, result.after) == (0, result.before)
    (unfixed,) = result.unfixed
    assert unfixed.finding in result.findings
    assert "'ascii' codec can't encode" in unfixed.reason
    continued = f"if 1:\n    \\\n{' ' * 3}for i in (1,): mujoco.mj_step(m, d); d.joint('a')\n"
    file.write_text(f"import mujoco\nd = mujoco.MjData(m)\n{continued}")
    (unfixed,) = lint_fixes.fix(str(file)).unfixed
    assert unfixed.reason == "the loop does not stand on lines of its own"


def test_a_deep_script_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(ACCESS + f"x = [1]{' + [1]' * 1500}\n")
    (unfixed,) = lint_fixes.fix(str(file)).unfixed
    assert unfixed.reason == "it is nested too deeply, or too large"


def notebook(*sources: str | list[str], **layout: Any) -> bytes:
    cells = [
        {"cell_type": "code", "metadata": {"é": 1.50}, "outputs": [{"text": ["1\n"]}], "source": s}
        for s in sources
    ]
    document = {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(document, **{"indent": 1, "ensure_ascii": False, **layout}).encode() + b"\n"


@pytest.mark.parametrize(
    "layout", [{}, {"indent": 2}, {"indent": "\t"}, {"indent": None}, {"ensure_ascii": True}]
)
@pytest.mark.parametrize("line_end", [b"\n", b"\r\n"])
@pytest.mark.parametrize("as_lines", [True, False])
def test_a_notebook_changes_in_its_loop_alone(
    tmp_path: Path, layout: dict[str, Any], line_end: bytes, as_lines: bool
) -> None:
    setup, loop = "%pip install ö\n", "log = []\n" + ACCESS.replace("print(", "log.append(")
    after = loop.replace("data.joint('a').qpos", "a_joint.qpos.copy()").replace(
        "for", "a_joint = data.joint('a')\nfor"
    )

    def content(text: str) -> bytes:
        lines = text.splitlines(keepends=True) if as_lines else text
        return notebook(setup, lines, "", **layout).replace(b"\n", line_end)

    assert fixed(tmp_path / "run.ipynb", content(loop)) == content(after)
    assert fixed(tmp_path / "run.ipynb", content(after)) == content(after)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (notebook(ACCESS).replace(b": ", b" : "), "the JSON of the notebook is not laid out"),
        (notebook(ACCESS).replace(b"1.5", b"1.50"), "the JSON of the notebook is not laid out"),
        (notebook([ACCESS]), "the lines of a cell are not stored as Jupyter does it"),
        (notebook(ACCESS.replace("\n", "\r\n")), "the lines of a cell are not stored"),
        (notebook(ACCESS + "    !ls\n"), "a command of IPython is in the loop"),
        (notebook("data = %sql x", ACCESS), "a command of IPython names data"),
    ],
)
def test_a_notebook_that_would_change_elsewhere_stays(
    tmp_path: Path, content: bytes, reason: str
) -> None:
    file = tmp_path / "run.ipynb"
    file.write_bytes(content)
    result = lint_fixes.fix(str(file))
    assert (result.fixed, result.after.data) == (0, content)
    (unfixed,) = result.unfixed
    assert unfixed.finding.code == NAMED_ACCESS
    assert unfixed.reason.startswith(reason)


def test_cells_are_one_program(tmp_path: Path) -> None:
    file = tmp_path / "run.ipynb"
    setup, loop = ACCESS[: ACCESS.index("for")], ACCESS[ACCESS.index("for") :]
    file.write_bytes(notebook(setup, "a_joint = 1", loop + "a_joint_2 = 2", loop))
    result = lint_fixes.fix(str(file))
    assert result.fixed == 2
    texts = [part.text for part in result.after.parts]
    assert texts[:2] == [setup, "a_joint = 1"]
    assert all(text.startswith("a_joint_3 = data.joint('a')\nfor") for text in texts[2:])
    assert result.diff().count("--- ") == 2
    assert f"--- {file}:cell 3\n+++ {file}:cell 3\n@@ -1,4 +1,5 @@\n" in result.diff()


def test_a_diff_is_one_that_patch_understands(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(ACCESS.removesuffix("\n"))
    assert lint_fixes.fix(str(file)).diff() == (
        f"--- {file}\n+++ {file}\n"
        "@@ -1,5 +1,6 @@\n"
        " from mujoco import MjData, mj_step\n"
        " data = MjData(model)\n"
        "+a_joint = data.joint('a')\n"
        " for i in range(9):\n"
        "     mj_step(model, data)\n"
        "-    print(data.joint('a').qpos)\n\\ No newline at end of file\n"
        "+    print(a_joint.qpos)\n\\ No newline at end of file\n"
    )
    assert file.read_text() == ACCESS.removesuffix("\n")


def test_a_link_stays_a_link_and_permissions_stay(tmp_path: Path) -> None:
    file, link = tmp_path / "script.py", tmp_path / "link.py"
    file.write_text(LOG + LOOP.format(line="log.append(data.qpos)"))
    file.chmod(0o640)
    link.symlink_to(file)
    result = lint_fixes.fix(str(link))
    result.write()
    assert result.fixed == 1
    assert link.is_symlink()
    assert ".copy()" in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o640


def test_rules_that_are_not_checked_change_nothing(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(f"log = []\n{ACCESS}" + LOOP.format(line="log.append(data.qpos)"))
    assert lint_fixes.fix(str(file), ["MJB003"]).fixed == 0
    assert lint_fixes.fix(str(file), [STORED_VIEW]).fixed == 1
    assert lint_fixes.fix(str(file), [NAMED_ACCESS]).fixed == 1
    assert lint_fixes.fix(str(file)).fixed == 2


def test_a_file_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "script.py"
    file.write_text(ACCESS)
    opened = []
    real = Path.open

    def counted(path: Path, *arguments: Any, **options: Any) -> Any:
        opened.append(path)
        return real(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", counted)
    (result,) = lint_fixes.lint_all([str(file)], fixes=True)
    assert isinstance(result, lint_fixes.LintedFile)
    assert result.findings == []
    assert opened == [file]


def test_what_cannot_be_read_or_written_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "script.py"
    file.write_text(ACCESS)
    folder = UncheckedFile("folder", "cannot be listed")
    results = list(lint_fixes.lint_all([str(file), "missing.py", folder], fixes=True))
    assert results[1:] == [UncheckedFile("missing.py", "no such file"), folder]
    with pytest.raises(InputError, match="nested too deeply"):
        file.write_text("-" * 100_000 + "1")
        lint_fixes.fix(str(file))

    @contextlib.contextmanager
    def full(_: Path) -> Iterator[Path]:
        raise OSError(28, "No space left on device")
        yield

    monkeypatch.setattr("mjbench.host.files.replacing", full)
    assert isinstance(results[0], lint_fixes.LintedFile)
    with pytest.raises(MachineError, match=r"cannot write .*script\.py: No space left"):
        results[0].write()
