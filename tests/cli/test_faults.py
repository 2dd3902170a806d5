"""Bad input, full disks, interrupts: one clear line, the right exit code, nothing lost."""

import contextlib
import errno
import json
import os
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import PYTHONPATH, Completed, mjbench, mjbench_process, python, started
from example_models import CONTACT_XML

from mjbench.cli import cli

QUICK = ["--nbatch", "6", "--nstep", "40", "--budget", "0.1", "--results", "runs"]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["compare", "cartpoel"], 2, "did you mean cartpole"),
        (["compare", "missing.xml"], 2, "no such file"),
        (["compare", "broken.xml"], 2, "MuJoCo cannot load it"),
        (["compare", "empty.xml"], 2, "empty.xml is empty"),
        (["compare", "still.xml"], 2, "nothing to step"),
        (["compare", "notes.txt"], 2, "ends in .xml, .urdf or .mjb"),
        (["compare", "timeless.xml"], 2, "its timestep is 0 s"),
        (["profile", "timeless.xml"], 2, "its timestep is 0 s"),
        (["compare", "."], 2, "is a folder"),
        (["compare", "no_such_package:ant"], 2, "no package 'no_such_package' is installed here"),
        (["compare", "cartpole", "--paths", "rolout"], 2, "did you mean rollout"),
        (["compare", "cartpole", "--nbatch", "0"], 2, "each at least 1 and at most"),
        (["compare", "cartpole", "--nbatch", "16,0"], 2, ": '0'"),
        (["compare", "cartpole", "--nstep", "-5"], 2, "'-5' is not a whole number, at least 1"),
        (["compare", "cartpole", "--nstep", "10", "--hold", "3"], 2, "not a multiple"),
        (["compare", "cartpole", "--nbatch", "1000000000"], 2, "reduce --nbatch"),
        (["compare", "cartpole", "--threads", "0"], 2, "each at least 1 and at most 1024"),
        (["compare", "cartpole", "--threads", "two"], 2, "whole numbers"),
        (["compare", "cartpole", "--option", "pool=warm"], 2, "pool is one of kept, new"),
        (["compare", "cartpole", "--option", "colour=red"], 2, "NAME one of"),
        (["compare", "cartpole", "--results", "notes.txt"], 3, "cannot write results"),
        (["compare", "cartpole", "--json", "no/such/folder.json"], 3, "cannot write"),
        (["models", "broken.xml"], 2, "MuJoCo cannot load it"),
        (["show", "missing.jsonl"], 2, "cannot read"),
        (["show", "notes.txt"], 2, "not a run file"),
        (["show"], 2, "no run file in"),
        (["comapre"], 2, "No such command"),
    ],
)
def test_bad_input_ends_in_one_clear_line(
    tmp_path: Path, words: list[str], code: int, message: str, inline: None
) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    (tmp_path / "empty.xml").write_text("")
    (tmp_path / "still.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    (tmp_path / "timeless.xml").write_text(
        CONTACT_XML.replace("<mujoco>", "<mujoco><option timestep='0'/>")
    )
    (tmp_path / "notes.txt").write_text("not a run\n")
    done = mjbench(*words, cwd=tmp_path)
    assert done.returncode == code
    assert message in done.stderr + done.stdout


def test_a_read_only_results_folder_is_reported_before_anything_is_measured(tmp_path: Path) -> None:
    done = mjbench("compare", "cartpole", "--results", "/proc/results", cwd=tmp_path)
    assert done.returncode == 3
    assert "--results" in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("when", "number"), [("at once", signal.SIGINT), ("while a path hangs", signal.SIGHUP)]
)
def test_an_interrupt_is_one_line_and_saves_what_was_measured(
    tmp_path: Path, contact_file: str, when: str, number: signal.Signals
) -> None:
    words = ["--paths", "python_loop_hold,wrong_paths:Tells,wrong_paths:Hangs", *QUICK]
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "scratch").mkdir()
    env = {"MJBENCH_TEST_PIPE": str(tmp_path / "pipe"), "TMPDIR": str(tmp_path / "scratch")}
    process = started("-m", "mjbench", "compare", contact_file, *words, cwd=tmp_path, env=env)
    if when == "while a path hangs":
        (tmp_path / "pipe").read_text()  # returns when the path before it was prepared
    process.send_signal(number)
    try:
        out, err = process.communicate(timeout=30)
    except subprocess.TimeoutExpired:  # an interpreter that starts may lose the first one
        process.send_signal(number)
        out, err = process.communicate(timeout=120)
    assert "Traceback" not in out + err
    if when == "at once":
        assert process.returncode in (-signal.SIGINT, 130)
        return
    assert process.returncode == 130
    progress, interrupted = err.splitlines()
    assert progress == f"{contact_file}: checking agreement"
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    assert interrupted == (
        "mjbench: interrupted; what was measured is saved; to go on, add"
        f" --resume runs/{file.name} to the command"
    )
    statuses = [json.loads(line).get("status") for line in file.read_text().splitlines()]
    assert statuses == [None, *["interrupted"] * 6]
    assert list((tmp_path / "scratch").iterdir()) == []


def test_a_closed_output_is_no_traceback(tmp_path: Path) -> None:
    program = (
        "import sys, pytest\n"
        "from example_races import invent_comparisons\n"
        "from mjbench.__main__ import main\n"
        "invent_comparisons(pytest.MonkeyPatch())\n"
        "sys.argv[0] = 'mjbench'\n"
        "main()"
    )
    process = started("-c", program, "compare", "cartpole", *QUICK, cwd=tmp_path)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()
    assert process.wait() == 3
    assert list((tmp_path / "runs").glob("*.jsonl"))


@pytest.mark.parametrize("words", [["compare", "m.xml"], ["lint", "a.py"], ["models", "m.xml"]])
def test_an_output_that_is_an_input_is_refused_and_the_file_stays(
    tmp_path: Path, words: list[str]
) -> None:
    (tmp_path / "m.xml").write_text(CONTACT_XML)
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "same").symlink_to(words[1])
    before = (tmp_path / words[1]).read_text()
    for target in (words[1], f"../{tmp_path.name}/{words[1]}", "same"):
        done = mjbench(*words, "--json", target, cwd=tmp_path)
        assert done.returncode == 2
        assert "choose another" in done.stderr
        assert (tmp_path / words[1]).read_text() == before


def test_a_document_replaces_an_earlier_one_only_when_it_is_complete(tmp_path: Path) -> None:
    (tmp_path / "out.json").write_text("earlier")
    done = mjbench("models", "missing.xml", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 2
    assert (tmp_path / "out.json").read_text() == "earlier"
    assert [file.name for file in tmp_path.iterdir()] == ["out.json"]


def test_an_unforeseen_error_is_one_line_with_the_details_in_a_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def fail(*arguments: object) -> None:
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("mjbench.paths.registry", fail)
    result = CliRunner().invoke(cli, ["paths"])
    assert result.exit_code == 3
    assert result.stderr.startswith("mjbench: unexpected ZeroDivisionError: two lines; ")
    assert result.stderr.count("\n") == 1
    (file,) = tmp_path.iterdir()
    assert str(file) in result.stderr
    assert "Traceback" in file.read_text()


def lint_to(target: str, cwd: Path) -> Completed:
    (cwd / "a.py").write_text("x = 1\n")
    return mjbench("lint", "a.py", "--json", target, cwd=cwd)


def test_a_document_is_written_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "target").write_text("earlier")
    (tmp_path / "target").chmod(0o640)
    (tmp_path / "link").symlink_to("target")
    assert lint_to("link", tmp_path).returncode == 0
    assert (tmp_path / "link").is_symlink()
    assert json.loads((tmp_path / "target").read_text())["findings"] == []
    assert (tmp_path / "target").stat().st_mode & 0o777 == 0o640


def test_a_pipe_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    (tmp_path / "a.py").write_text("x = 1\n")
    done = mjbench_process("lint", "a.py", "--json", "pipe", cwd=tmp_path)
    assert done.returncode == 0
    assert json.loads(os.read(reader, 1 << 16))["findings"] == []
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize(
    "target", ["folder", "folder/", "", " /x", "loop", "x" * 5_000, "/proc/x", "no/such", "a\0b"]
)
def test_an_output_that_cannot_be_written_is_one_line(tmp_path: Path, target: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "a.py").write_text("x = 1\n")
    files = sorted(tmp_path.iterdir())
    with contextlib.chdir(tmp_path):
        done = CliRunner().invoke(cli, ["lint", "a.py", "--json", target])
    assert done.exit_code == 3
    assert done.stderr.startswith("mjbench: cannot write ")
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == files


@pytest.mark.parametrize("words", [["--help"], ["paths"], ["paths", "--json", "-"]])
def test_a_full_disk_behind_standard_output_is_one_line(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = python("-m", "mjbench", *words, stdout=full)
    assert done.returncode == 3
    assert done.stderr.count("mjbench: ") == 1
    assert "No space left on device" in done.stderr.splitlines()[-1]


def test_mujoco_that_cannot_be_imported_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "class Finder:\n"
        "    def find_spec(name, path=None, target=None):\n"
        "        if name == 'mujoco':\n"
        "            raise ImportError('libGL.so.1: no such file')\n"
        "sys.meta_path.insert(0, Finder)\n"
    )
    (tmp_path / "m.xml").write_text(CONTACT_XML)
    environment = {"PYTHONPATH": f"{tmp_path}:{PYTHONPATH}", "TMPDIR": str(tmp_path)}
    for words in (["compare", "m.xml"], ["models", "m.xml"], ["profile", "m.xml"]):
        done = mjbench_process(*words, cwd=tmp_path, env=environment)
        assert done.returncode == 3
        assert "libGL.so.1: no such file" in done.stdout + done.stderr
        assert "report it" not in done.stderr


@pytest.mark.parametrize(
    ("cause", "line"),
    [
        (OSError(errno.EMFILE, "Too many open files"), "[Errno 24] Too many open files"),
        (OSError(errno.ENOSPC, "No space left on device"), "[Errno 28] No space left on device"),
        (MemoryError(), "out of memory"),
    ],
)
def test_a_machine_that_is_used_up_is_one_line_and_nothing_to_report(
    monkeypatch: pytest.MonkeyPatch, cause: Exception, line: str
) -> None:
    def fail(*arguments: object) -> None:
        try:
            raise cause
        except Exception as error:
            raise ImportError("cannot import a part of this program") from error

    monkeypatch.setattr("mjbench.paths.registry", fail)
    result = CliRunner().invoke(cli, ["paths"])
    assert result.exit_code == 3
    assert result.stderr == f"mjbench: {line}\n"


@pytest.mark.parametrize(
    "words", [["compare", "pile"], ["versions", "installed", "installed", "pile"]]
)
def test_a_disk_without_room_for_scratch_files_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: list[str]
) -> None:
    def refuse(*arguments: object, **named: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryDirectory", refuse)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 3
    assert result.stderr.count("\n") == 1
    assert "cannot create a temporary folder: [Errno 28] No space left" in result.stderr
