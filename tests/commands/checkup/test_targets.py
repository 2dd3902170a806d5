"""What a name stands for: a model, a program, a notebook or an environment; else a question."""

from pathlib import Path

import pytest

from mjbench.commands.checkup import targets
from mjbench.commands.checkup.targets import ProgramFile, TargetKind
from mjbench.errors import InputError

_XML = "<mujoco/>"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with a model, a program, a notebook and a run file."""
    for name in ("robot.xml", "robot.urdf", "robot.mjb"):
        (tmp_path / name).write_text(_XML)
    for name in ("train.py", "notes.ipynb", "my_env.py"):
        (tmp_path / name).write_text("{}")
    (tmp_path / "run.jsonl").write_text("{}")
    (tmp_path / "assets").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("robot.xml", TargetKind.MODEL),
        ("robot.urdf", TargetKind.MODEL),
        ("robot.mjb", TargetKind.MODEL),
        ("cartpole", TargetKind.MODEL),
        ("gymnasium:ant", TargetKind.MODEL),
        ("train.py", TargetKind.PROGRAM),
        ("Humanoid-v5", TargetKind.ENVIRONMENT),
        ("my_package:Robot-v0", TargetKind.ENVIRONMENT),
        ("dm_control:humanoid-walk", TargetKind.ENVIRONMENT),
        ("my_env:make", TargetKind.ENVIRONMENT),
        ("json:loads", TargetKind.ENVIRONMENT),
    ],
)
def test_a_name_stands_for_one_thing(folder: Path, name: str, kind: TargetKind) -> None:
    source = targets.recognized(name, (), folder)
    assert targets.kind_of(source) == kind
    assert source.name == name
    assert targets.may_be_target(name)


def test_a_program_has_arguments(folder: Path) -> None:
    source = targets.recognized("train.py", ("--num-envs", "4"), folder)
    assert source == ProgramFile(("train.py", "--num-envs", "4"), Path("train.py"))


def test_a_module_is_a_program_whose_file_is_read_where_it_is_below_the_folder(
    folder: Path,
) -> None:
    for words, path in ((("train", "--fast"), folder / "train.py"), (("json.tool",), None)):
        assert targets.recognized("-m", words, folder) == ProgramFile(("-m", *words), path)


def test_what_could_be_two_things_is_asked_about(folder: Path) -> None:
    (folder / "gymnasium.py").write_text("")
    with pytest.raises(InputError, match=r"mjbench profile gymnasium:ant.* or `mjbench env"):
        targets.recognized("gymnasium:ant", (), folder)


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("run.jsonl", (), "is a run file: `mjbench show` prints it"),
        ("assets", (), "is a folder; give a shipped model"),
        ("missing.py", (), "no such file: missing.py"),
        ("missing.xml", (), "no such file: missing.xml"),
        ("assets/x.py", (), "no such file"),
        ("gymnasium:antt", (), "did you mean ant"),
        ("humaniod", (), "did you mean humanoid"),
        ("no_such_package:make", (), "no package 'no_such_package' is installed here"),
        ("https://x.org/robot", (), "is an address"),
        ("robot.xml", ("other.xml",), "one thing at a time"),
        ("notes.ipynb", (), "is a notebook: save it as a Python file"),
        ("a\0b.py", (), "no such file"),
    ],
)
def test_what_stands_for_nothing_is_one_line(
    folder: Path, name: str, arguments: tuple[str, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message) as raised:
        targets.recognized(name, arguments, folder)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("word", ["comapre", "--quick", "plna", "prof", "tnue"])
def test_a_mistyped_command_is_no_target(folder: Path, word: str) -> None:
    assert not targets.may_be_target(word)


def test_an_empty_name_is_said_to_be_empty(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the name is empty; give a shipped model"):
        targets.recognized("", (), tmp_path)
