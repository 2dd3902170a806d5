"""Which rules are checked in a file, by pyproject.toml and by the command line."""

from pathlib import Path

import pytest

from mjbench.commands.lint.settings import ALL_CODES, RuleChoice
from mjbench.errors import InputError


def write(folder: Path, text: str) -> None:
    (folder / "pyproject.toml").write_text(text)


def test_without_settings_all_rules_are_checked(tmp_path: Path) -> None:
    write(tmp_path, "[tool.other]\n")
    assert RuleChoice().codes_for(str(tmp_path / "a.py")) == list(ALL_CODES)


def test_the_nearest_settings_count(tmp_path: Path) -> None:
    write(tmp_path, '[tool.mjbench.lint]\nselect = ["MJB001", "MJB002"]\n')
    inner = tmp_path / "inner"
    inner.mkdir()
    choice = RuleChoice()
    assert choice.codes_for(str(inner / "a.py")) == ["MJB001", "MJB002"]
    write(inner, '[tool.mjbench.lint]\nignore = ["MJB00"]\n')
    assert RuleChoice().codes_for(str(inner / "a.py"))[0] == "MJB010"


def test_the_command_line_takes_precedence(tmp_path: Path) -> None:
    write(tmp_path, '[tool.mjbench.lint]\nselect = ["MJB001"]\nignore = ["MJB002"]\n')
    file = str(tmp_path / "a.py")
    assert RuleChoice(select=("MJB003", "MJB002")).codes_for(file) == ["MJB003"]
    assert RuleChoice(("MJB003", "MJB002"), ("MJB003",)).codes_for(file) == ["MJB002"]


def test_files_may_leave_out_more(tmp_path: Path) -> None:
    write(
        tmp_path,
        '[tool.mjbench.lint]\nselect = ["MJB001", "MJB006"]\n'
        '[tool.mjbench.lint.per-file-ignores]\n"tests/*" = ["MJB006"]\n"*_test.py" = ["MJB"]\n',
    )
    choice = RuleChoice()
    assert choice.codes_for(str(tmp_path / "tests/inner/a.py")) == ["MJB001"]
    assert choice.codes_for(str(tmp_path / "src/a_test.py")) == []
    assert choice.codes_for(str(tmp_path / "src/a.py")) == ["MJB001", "MJB006"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[tool.mjbench.lint]\nselct = []", "no key 'selct'; there are select, ignore, per-file-"),
        ('[tool.mjbench.lint]\nselect = "MJB001"', "select is not a list of codes"),
        ("[tool.mjbench.lint]\nignore = [1]", "ignore is not a list of codes"),
        ('[tool.mjbench.lint]\nignore = ["E501"]', "ignore: no rule 'E501'; there are MJB001"),
        ("[tool.mjbench]\nlint = 1", "not a table"),
        ("[tool.mjbench.lint]\nper-file-ignores = []", "per-file-ignores is not a table"),
        (
            "[tool.mjbench.lint.per-file-ignores]\n'a.py' = 1",
            "per-file-ignores of 'a.py' is not a list of codes",
        ),
        ("[tool", "Expected"),
    ],
)
def test_settings_that_mean_nothing_are_refused_in_one_line(
    tmp_path: Path, text: str, message: str
) -> None:
    write(tmp_path, text)
    with pytest.raises(InputError, match=r"pyproject\.toml: ") as error:
        RuleChoice().codes_for(str(tmp_path / "a.py"))
    assert message in str(error.value)
    assert "\n" not in str(error.value)
