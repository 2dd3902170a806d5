"""`mjbench TARGET`: what it resolves to, one quick check-up, and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path
from unittest import mock

import inline_tasks
import pytest
from commands import ROOT, Completed, mjbench, mjbench_process

import mjbench as package
from mjbench.commands.checkup.driver import CheckupPlan
from mjbench.commands.profile import measure as profile
from mjbench.host import isolate

CARTPOLE = ROOT / "models" / "cartpole.xml"


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Completed]:
    """Return a folder in which the cart-pole was checked without a subcommand, and the command."""
    folder = tmp_path_factory.mktemp("checked")
    words = [str(CARTPOLE), "--quick", "--json", "c.json", "--html", "c.html"]
    times = replace(CheckupPlan(is_quick=True).times, end=2.0, paths=2.0)
    with (
        mock.patch.object(CheckupPlan, "times", times),
        mock.patch.object(profile, "BUDGET_S", 0.05),
        mock.patch.object(isolate, "run", inline_tasks.run),
    ):
        return folder, mjbench(*words, "--results", "runs", cwd=folder)


def test_a_model_without_a_subcommand_is_checked(checked: tuple[Path, Completed]) -> None:
    folder, done = checked
    assert done.returncode == 0, done.stderr
    document = json.loads((folder / "c.json").read_text())
    assert [part["part"] for part in document["parts"]] == ["profile", "compare"]
    assert {part["status"] for part in document["parts"]} == {"ok"}
    assert "Where a step's time goes" in done.stdout
    assert f"Settings were not tried: mjbench tune {CARTPOLE}" in done.stdout


def test_it_is_one_run_file_that_show_and_load_read(checked: tuple[Path, Completed]) -> None:
    folder, done = checked
    (file,) = (folder / "runs").iterdir()
    shown = mjbench("show", str(file), cwd=folder)
    assert shown.returncode == 0, shown.stderr
    conclusion = next(
        line for line in done.stdout.splitlines() if line.startswith("cartpole.xml: ")
    )
    assert conclusion in shown.stdout
    document = json.loads((folder / "c.json").read_text())
    actions = [row["action"] for row in package.load(file) if row.get("action")]
    assert actions == [item["action"] for item in document["items"]]
    assert "what to do first" in (folder / "c.html").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["comapre"], "Did you mean 'compare'?"),
        (["missing.xml"], "no such file: missing.xml"),
        (["train.py"], "no such file: train.py"),
        (["empty.xml"], "is empty"),
        (["broken.xml"], "cannot load it"),
        (["broken.py"], "broken.py"),
        (["robot.xml", "other.xml"], "one thing at a time"),
        (["robot.xml", "--num-envs", "8"], "No such option '--num-envs'"),
        (["--quick", "compare", "robot.xml"], "follow its name: mjbench compare"),
        (["--verison"], "Did you mean '--version'?"),
        (["help", "comapre"], "Did you mean 'compare'?"),
        (["robot.xml", "--html", "robot.xml"], "is a file that this command reads"),
        (["--settle", "1s", "broken.py"], "start states are of a model"),
        ([], "Usage: mjbench"),
    ],
)
def test_what_cannot_be_checked_is_one_line(tmp_path: Path, words: list[str], message: str) -> None:
    (tmp_path / "empty.xml").write_text("")
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody><geom/></mujoco>")
    (tmp_path / "broken.py").write_text("def (:")
    (tmp_path / "robot.xml").write_text(CARTPOLE.read_text())
    done = mjbench(*words, cwd=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert message in done.stderr


@pytest.mark.parametrize(
    ("text", "code", "says"),
    [
        ("x = 1\nraise ValueError('no')", 1, "it raised ValueError: no at program.py:2"),
        ("raise SystemExit(7)", 7, "it ended with exit code 7"),
        ("print('well')", 0, "nothing was measured"),
    ],
)
def test_a_program_that_fails_ends_its_check_up_with_its_own_code(
    tmp_path: Path, text: str, code: int, says: str
) -> None:
    (tmp_path / "program.py").write_text(text)
    done = mjbench("--quick", "program.py", cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert says in done.stderr


@pytest.mark.parametrize("words", [["program.py"], ["-m", "program"]], ids=" ".join)
@pytest.mark.parametrize("command", [[], ["run"]], ids=["checkup", "run"])
def test_options_before_a_program_are_those_of_mjbench_and_all_after_it_its_own(
    tmp_path: Path, command: list[str], words: list[str]
) -> None:
    (tmp_path / "program.py").write_text("import sys\nopen('words', 'w').write(str(sys.argv[1:]))")
    done = mjbench(*command, "--seconds", "none", *words, "--seconds", "--help", "--", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "words").read_text() == "['--seconds', '--help', '--']"


def test_help_of_a_program_does_not_run_it(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text("raise SystemExit(7)")
    for words in (["program.py"], ["run", "program.py"]):
        done = mjbench("help", *words, cwd=tmp_path)
        assert (done.returncode, done.stdout[:6]) == (0, "Usage:")


def test_a_check_up_that_is_interrupted_keeps_what_it_has(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(
        "import os, signal, time\n"
        "signal.signal(signal.SIGINT, lambda *_: os._exit(1))\n"
        "os.kill(os.getppid(), signal.SIGTERM)\n"
        "time.sleep(60)\n"
    )
    done = mjbench_process("program.py", cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert "mjbench: interrupted; what was measured is saved" in done.stderr
    assert "program.py: interrupted, so the list is not complete" in done.stderr
    (file,) = (tmp_path / "results" / "runs").iterdir()
    assert mjbench("show", str(file), cwd=tmp_path).returncode == 0
