"""What a command cannot write ends it with exit code 3, whatever prints it."""

import io
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

import pytest
from commands import PYTHONPATH, python
from example_races import invent_comparisons

from mjbench.cli import cli, standard_streams
from mjbench.status import ExitCode

COMPARE = ["compare", "cartpole", "--nbatch", "6", "--nstep", "40", "--budget", "0.1"]


def code_of(*words: str, **streams: io.TextIOBase) -> int:
    """Return the exit code of a command in this process, with other streams; close them."""
    with mock.patch.multiple(sys, **streams), pytest.raises(SystemExit) as ending:
        cli.main(words, prog_name="mjbench")
    for stream in streams.values():
        stream.close()
    assert isinstance(ending.value.code, int)
    return ending.value.code


def code_with_full_error(*words: str) -> int:
    return code_of(*words, stderr=Path("/dev/full").open("w"))


@pytest.mark.parametrize(
    "words",
    [
        ["show", "missing.jsonl"],
        ["compare", "missing.xml"],
        ["compare", "--nope"],
        ["lint", "missing.py"],
        ["versions", "3.17.0", "4.0.0", "missing.xml", "--fail-on", "slower"],
        ["ab", "missing.xml", "missing.xml"],
        ["missing"],
        ["missing.xml"],
    ],
    ids=" ".join,
)
def test_an_error_that_cannot_be_printed_is_no_finding(words: list[str]) -> None:
    assert code_with_full_error(*words) == ExitCode.ENVIRONMENT


@pytest.mark.parametrize("color", ["", "1"], ids=["lines", "bar"])
def test_progress_that_cannot_be_printed_costs_no_result(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], color: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FORCE_COLOR", color)  # as on a terminal
    invent_comparisons(monkeypatch)
    assert code_with_full_error(*COMPARE, "--json", "-") == ExitCode.ENVIRONMENT
    assert '"cartpole"' in capsys.readouterr().out


def test_a_line_of_a_library_that_cannot_be_printed_is_exit_code_3() -> None:
    with (
        Path("/dev/full").open("w") as full,
        mock.patch.object(sys, "stderr", full),
        pytest.raises(SystemExit) as ending,
        standard_streams.checked(),
    ):
        sys.stderr.write("a library's line\n")
        sys.exit(ExitCode.OK)
    assert ending.value.code == ExitCode.ENVIRONMENT


def test_a_command_that_prints_no_error_ends_as_ever() -> None:
    assert code_with_full_error("--version") == ExitCode.OK


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["paths"], ["lint", "--help"]])
def test_output_that_nobody_reads_is_no_finding(words: list[str]) -> None:
    assert code_of(*words, stdout=closed_pipe()) == ExitCode.ENVIRONMENT


@pytest.mark.parametrize("words", [["missing"], ["show", "missing.jsonl"]])
def test_an_error_that_nobody_reads_is_no_finding(words: list[str]) -> None:
    assert code_of(*words, stderr=closed_pipe()) == ExitCode.ENVIRONMENT


def closed_pipe() -> io.TextIOWrapper:
    reading, writing = os.pipe()
    os.close(reading)
    return io.TextIOWrapper(io.FileIO(writing, "w"), write_through=True)  # nothing stays unwritten


@pytest.mark.parametrize("words", [["show", "missing.jsonl"], ["--nope"]], ids=" ".join)
@pytest.mark.parametrize(("stream", "code"), [("2>/dev/full", 3), ("2>&-", 2)])
def test_the_process_ends_with_the_code_of_the_command(
    words: list[str], stream: str, code: int
) -> None:
    environment = {**os.environ, "PYTHONPATH": PYTHONPATH}
    shell = f'exec "$0" -m mjbench "$@" {stream}'
    done = subprocess.run(["sh", "-c", shell, sys.executable, *words], env=environment, check=False)
    assert done.returncode == code


def test_a_start_that_fails_where_standard_error_is_full_is_exit_code_3() -> None:
    program = "import sys; sys.modules['click'] = None\nfrom mjbench.__main__ import main; main()"
    with Path("/dev/full").open("w") as full:
        done = python("-c", program, stderr=full)
    assert done.returncode == ExitCode.ENVIRONMENT
