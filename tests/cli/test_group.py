"""What every command shares: help, version, missing packages."""

import os
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import PYTHONPATH, ROOT, mjbench_process, python

from mjbench import errors
from mjbench.cli import group
from mjbench.errors import MachineError


def test_help_and_version_need_no_engine() -> None:
    program = (
        "import sys; sys.argv = ['mjbench', sys.argv[1]]\n"
        "from mjbench.__main__ import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "heavy = {'mujoco', 'numpy', 'jax', 'scipy', 'msgspec', 'rich.console'}\n"
        "heavy &= set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    for word in ("--help", "--version"):
        done = python("-c", program, word)
        assert done.returncode == 0, done.stderr
        assert "mjbench" in done.stdout


def test_without_its_optional_packages_the_command_says_what_to_install() -> None:
    program = "import sys; sys.modules['click'] = None\nfrom mjbench.__main__ import main; main()"
    done = python("-c", program)
    assert done.returncode != 0
    assert "python -m pip install " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "env", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}], ids=str
)
def test_a_character_that_the_output_lacks_costs_no_table(env: dict[str, str]) -> None:
    run = str(ROOT / "results/runs/reference-mujoco-4.0.0.jsonl")
    done = mjbench_process("show", run, env=env)
    assert done.returncode == 0, done.stderr
    assert "cartpole: 64 simulations \\xd7 61 steps" in done.stdout


@pytest.mark.parametrize("words", [("lint", ""), ("show", ""), ("show", "--results", "")])
def test_an_empty_name_of_a_file_is_said_to_be_empty(words: tuple[str, ...]) -> None:
    done = CliRunner().invoke(group.cli, words)
    assert done.exit_code == 2
    assert "the name is empty" in done.output


def test_a_current_folder_that_was_removed_is_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    done = mjbench_process("models", cwd=folder, preexec_fn=folder.rmdir)
    assert done.returncode == 3
    assert done.stderr == "mjbench: the current folder no longer exists; change to another one\n"


@pytest.mark.parametrize("words", [("compare", "cartpole"), ("run", "prog.py"), ("prog.py",)])
@pytest.mark.parametrize(
    ("name", "content"), [("mujoco.py", "x = 1"), ("numpy.py", "import sys; sys.exit(5)")]
)
def test_a_module_in_the_place_of_a_package_is_one_line(
    name: str, content: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "prog.py").touch()
    file = tmp_path / "path" / name
    file.parent.mkdir()
    file.write_text(content)
    path = os.pathsep.join([str(file.parent), PYTHONPATH])
    done = mjbench_process(*words, cwd=tmp_path, env={"PYTHONPATH": path})
    assert done.returncode == 3
    assert done.stderr.startswith(f"mjbench: {file} is imported in the place of the package ")
    assert done.stderr.count("\n") == 1


def test_a_rendering_library_that_cannot_be_loaded_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    program = compile("None.glGetError", "/site-packages/OpenGL/error.py", "eval")
    with pytest.raises(AttributeError) as raised:
        eval(program)
    line = errors.describe_unforeseen(raised.value)
    assert line.startswith("MuJoCo cannot load the rendering library of MUJOCO_GL=osmesa (")
    assert line.endswith("install it, or unset MUJOCO_GL")


def test_a_command_without_its_group_has_the_same_help() -> None:
    context = group.cli.commands["doctor"].make_context("doctor", [])
    assert context.help_option_names == ["-h", "--help"]


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ImportError("initialization failed"), "interrupted"),
        (MachineError("cannot write x"), "cannot write x"),
    ],
    ids=["import", "cleanup"],
)
def test_an_interrupt_that_becomes_another_error_stays_one(
    monkeypatch: pytest.MonkeyPatch, error: Exception, line: str
) -> None:
    def fail(*arguments: object) -> None:
        try:
            raise KeyboardInterrupt
        finally:
            raise error

    monkeypatch.setattr("mjbench.paths.registry", fail)
    result = CliRunner().invoke(group.cli, ["paths"])
    assert (result.exit_code, result.stderr) == (130, f"mjbench: {line}\n")
