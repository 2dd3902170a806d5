"""What `--fix` changes in a script, and what it leaves as it is."""

from pathlib import Path

import pytest

from mjbench.loop import lint, lint_fixes

LOOP = "for i in range(9):\n    mj_step(model, data)\n    {line}\n"


def fixed(file: Path, content: bytes) -> bytes:
    file.write_bytes(content)
    lint_fixes.fix(str(file))
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
    text, expected = LOOP.format(line=line), LOOP.format(line=after)
    assert fixed(tmp_path / "script.py", text.encode()).decode() == expected
    remaining = lint.check(str(tmp_path / "script.py"))
    assert all(finding.code not in lint_fixes.FIXABLE for finding in remaining)


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_encoding_and_line_ends_stay(tmp_path: Path, end: str, encoding: str) -> None:
    declared = f"# coding: {encoding}\nname = 'ö'\n" + LOOP.format(line="log.append(data.qpos)")
    content = declared.replace("\n", end).encode(encoding)
    expected = content.replace(b"data.qpos)", b"data.qpos.copy())")
    assert fixed(tmp_path / "script.py", content) == expected


def test_a_link_stays_a_link_and_permissions_stay(tmp_path: Path) -> None:
    file, link = tmp_path / "script.py", tmp_path / "link.py"
    file.write_text(LOOP.format(line="log.append(data.qpos)"))
    file.chmod(0o640)
    link.symlink_to(file)
    assert lint_fixes.fix(str(link)) == 1
    assert link.is_symlink()
    assert ".copy()" in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o640


def test_rules_that_are_not_checked_change_nothing(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(LOOP.format(line="log.append(data.qpos)"))
    assert lint_fixes.fix(str(file), ["MJB003"]) == 0
    assert lint_fixes.fix(str(tmp_path / "book.ipynb")) == 0
