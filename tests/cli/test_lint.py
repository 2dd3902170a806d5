"""`mjbench lint` as a user types it."""

import json
import os
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from commands import mjbench

from mjbench.cli import cli
from mjbench.commands.lint.rules import RULES

LOOP = """
import mujoco

data = mujoco.MjData(model)
log = []
for i in range(100):
    mujoco.mj_step(model, data)
    log.append({value})
"""
BAD, GOOD = LOOP.format(value="data.qpos"), LOOP.format(value="data.qpos.copy()")


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def lint(*words: str) -> Result:
    return CliRunner().invoke(cli, ["lint", *words])


def test_it_prints_like_a_linter_and_exits_1(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(BAD)
    done = mjbench("lint", "bad.py", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.startswith("bad.py:8:16 MJB001 a view is stored")
    (finding,) = json.loads((tmp_path / "out.json").read_text())["findings"]
    keys = {"file", "line", "col", "code", "message", "ns_per_step"}
    assert set(finding) == keys | {"instead", "is_wrong_result", "last_line"}


def test_a_clean_folder_exits_0(tmp_path: Path) -> None:
    (tmp_path / "good.py").write_text(GOOD)
    done = lint(".")
    assert (done.exit_code, done.output) == (0, "No findings in 1 file.\n")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("missing.py", "no such file"),
        ("empty", "no Python file in this folder"),
        ("broken.py", "line 1: invalid syntax"),
        ("robot.xml", "lint reads Python files; `mjbench MODEL` and"),
        ("robot.mjb", "lint reads Python files; `mjbench MODEL` and"),
        ("run.ipynb", "a notebook; save it as a Python file: jupyter nbconvert --to script"),
        ("pipe.py", "not a regular file"),
        ("/dev/zero", "not a regular file"),
        ("loop.py", "cannot be read: Too many levels of symbolic links"),
    ],
)
def test_what_cannot_be_checked_is_one_line_and_exit_code_2(
    tmp_path: Path, name: str, reason: str
) -> None:
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.py").write_text("def (")
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    (tmp_path / "robot.mjb").write_bytes(b"\xa1\xd4\0")
    (tmp_path / "run.ipynb").write_text("{}")
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "loop.py").symlink_to("loop.py")
    done = lint("good.py", name, "--json", "out.json")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.startswith(f"mjbench: {name}: {reason}")
    assert done.stderr.count("\n") == 1
    document = json.loads((tmp_path / "out.json").read_text())
    (unchecked,) = document["unchecked"]
    assert unchecked["file"] == name
    assert unchecked["detail"].startswith(reason)


def test_findings_of_others_are_kept_and_decide_the_exit_code(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(BAD)
    (tmp_path / "broken.py").write_text("-" * 100_000)
    (tmp_path / "c.py").write_text(BAD)
    done = lint(".", "missing.py", "--json", "out.json")
    assert done.exit_code == 1
    assert [line.partition(":")[0] for line in done.stdout.splitlines()] == ["a.py", "c.py"]
    assert [line.split(": ")[1] for line in done.stderr.splitlines()] == ["broken.py", "missing.py"]
    document = json.loads((tmp_path / "out.json").read_text())
    assert len(document["findings"]) == len(document["unchecked"]) == 2


@pytest.mark.parametrize(("text", "code"), [(BAD, 1), (GOOD, 0), ("def (", 2)])
def test_a_name_that_is_not_utf8_is_printed_escaped_and_stored(
    tmp_path: Path, text: str, code: int
) -> None:
    name = os.fsdecode(b"a\xff\n\x1b[31m.py")
    (tmp_path / name).write_text(text)
    done = mjbench("lint", ".", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == code
    printed = done.stdout + done.stderr
    assert printed.count("\n") == len(printed.splitlines()) == 1
    assert not code or r"a\udcff\n\x1b[31m.py:" in printed
    document = json.loads((tmp_path / "out.json").read_text())
    assert [row["file"] for key in ("findings", "unchecked") for row in document[key]] == (
        [name] if code else []
    )


def test_json_on_standard_output_is_all_there_is(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(BAD)
    done = lint("a.py", "missing.py", "--json", "-")
    assert done.exit_code == 1
    assert set(json.loads(done.stdout)) == {"schema", "findings", "unchecked"}
    assert done.stderr.count("\n") == 2


def test_rules_are_selected_and_ignored(tmp_path: Path) -> None:
    text = BAD + "    data.joint('x').qpos\n    u = np.zeros(3)\n"
    (tmp_path / "a.py").write_text(text)
    for words, found in (
        ((), ["MJB001", "MJB002", "MJB003"]),
        (("--select", "MJB001,mjb003"), ["MJB001", "MJB003"]),
        (("--ignore", "MJB002"), ["MJB001", "MJB003"]),
        (("--select", "MJB", "--ignore", "MJB001"), ["MJB002", "MJB003"]),
    ):
        done = lint("a.py", *words)
        assert [line.split()[1] for line in done.stdout.splitlines()] == found
    done = lint("a.py", "--select", "E501")
    assert done.exit_code == 2
    assert "no rule 'E501'; there are MJB001" in done.stderr


def test_findings_become_annotations(tmp_path: Path) -> None:
    (tmp_path / "a,b:c.py").write_text(BAD)
    done = lint("a,b:c.py", "missing.py", "--github", "annotations", "--json", "-")
    assert json.loads(done.stdout)["findings"]
    first, second = (tmp_path / "annotations").read_text().splitlines()
    assert first.startswith("::error file=a%2Cb%3Ac.py,line=8,col=16,title=MJB001::")
    assert second == "::warning file=missing.py,title=not checked::no such file"
    assert done.exit_code == 1


def test_findings_become_sarif(tmp_path: Path) -> None:
    (tmp_path / "a b.py").write_text(BAD)
    done = lint(".", "missing.py", "--sarif", "-")
    (run,) = json.loads(done.stdout)["runs"]
    assert run["invocations"][0]["executionSuccessful"] is False
    rules = {rule["id"] for rule in run["tool"]["driver"]["rules"]}
    (first,) = run["results"]
    assert first["ruleId"] in rules
    assert first["level"] == "error"  # a wrong result
    place = first["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == "a%20b.py"
    assert place["region"] == {"startLine": 8, "startColumn": 16}


def test_two_forms_are_not_written_to_one_place(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(BAD)
    for name in ("-", "out"):
        done = lint("a.py", "--github", name, "--json", name)
        assert done.exit_code == 2
        assert f"--json {name} is what --github writes, too" in done.stderr


def test_pyproject_selects_rules_and_the_command_line_others(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(BAD + "    u = np.zeros(3)\n")
    (tmp_path / "pyproject.toml").write_text('[tool.mjbench.lint]\nselect = ["MJB003"]\n')
    assert [line.split()[1] for line in lint("a.py").stdout.splitlines()] == ["MJB003"]
    done = lint("a.py", "--select", "MJB001")
    assert [line.split()[1] for line in done.stdout.splitlines()] == ["MJB001"]


def test_settings_that_mean_nothing_print_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(BAD)
    (tmp_path / "pyproject.toml").write_text("[tool.mjbench.lint]\nselct = []\n")
    done = lint("a.py")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "[tool.mjbench.lint]: no key 'selct'; there are select, ignore" in done.stderr
    assert done.stderr.count("\n") == 1


def test_statistics_count_findings_by_rule(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(BAD + "    u = np.zeros(3)\n" * 10)
    done = lint("a.py", "--statistics")
    assert done.exit_code == 1
    first, second = done.stdout.splitlines()
    assert first.startswith(" 1 MJB001 a view is stored")
    assert second.startswith("10 MJB003 a new array in every step")


def test_a_rule_is_explained_without_a_file() -> None:
    done = lint("--rule", "mjb001")
    assert done.exit_code == 0
    assert done.stdout.startswith("MJB001 (wrong result): a view is stored")
    assert "log.append(data.qpos.copy())" in done.stdout
    assert lint("--rule", "mjb001", "--help").stdout.startswith("Usage: ")
    done = lint("--rule", "MJB999")
    assert done.exit_code == 2
    assert "no rule 'MJB999'; there are MJB001" in done.stderr


def test_all_rules_are_listed() -> None:
    done = lint("--rule", "all")
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert len(lines) == len(RULES)
    assert lines[0].startswith("MJB001 (wrong result): a view is stored")


def test_a_file_or_a_folder_is_asked_for() -> None:
    done = lint()
    assert done.exit_code == 2
    assert "no file or folder is given" in done.stderr
