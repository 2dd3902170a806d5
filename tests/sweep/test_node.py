"""A node runs a command, sends its lines as they come, and leaves nothing behind."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import process_tree
import pytest
from example_models import CONTACT_XML

from mjbench.simulation import carried_models
from mjbench.simulation.models import ModelSource
from mjbench.status import ExitCode
from mjbench.sweep import model_files, node
from mjbench.sweep.calibration import Limits, NodeState
from mjbench.sweep.commands import CommandLine
from mjbench.sweep.messages import Began, Finished, Lines, Message, Refused, Request

LINE = CommandLine(("instructions", "--release", "4.0.0"), ("pile",))
QUIET = NodeState(cores=2, usable_cores=2, cores_had=2.0, busy_cores=0.0, stolen=0.0)
# Programs that stand for mjbench. The first writes a run file in pieces, the last one cut short.
WRITES = """
import pathlib, sys
folder = pathlib.Path(sys.argv[sys.argv.index("--results") + 1])
folder.mkdir()
with open(folder / "run.jsonl", "w") as file:
    file.write("header\\nfir"); file.flush()
    file.write("st\\nsecond\\ncut"); file.flush()
"""
FAILS = "import sys; print('mjbench: the disk is full', file=sys.stderr); sys.exit(3)"
HANGS = "import os, sys; print(os.getpid(), flush=True); import signal; signal.pause()"
DESCRIBES = """
import json, os, pathlib, sys
start = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)])
pathlib.Path(os.environ["START_FILE"]).write_text(start)
"""


def request(program: str, limits: Limits | None = None, label: str = "") -> Request:
    return Request(LINE, limits, label, (sys.executable, "-c", program))


def measure(asked: Request) -> list[Message]:
    return list(node.measure(asked, calibrate=lambda: QUIET))


def test_whole_lines_are_sent_and_a_line_that_was_cut_short_is_not() -> None:
    began, *others, finished = measure(request(WRITES))
    assert began == Began()
    sent = [line for message in others if isinstance(message, Lines) for line in message.lines]
    assert sent == [b"header\n", b"first\n", b"second\n"]
    assert isinstance(finished, Finished)
    assert (finished.exit_code, finished.detail) == (0, "")


def test_a_command_that_fails_says_why() -> None:
    *_, finished = measure(request(FAILS))
    assert isinstance(finished, Finished)
    assert (finished.exit_code, finished.detail) == (3, "the disk is full")


def test_a_program_that_cannot_start_is_the_nodes_failure() -> None:
    (finished,) = measure(Request(LINE, program=("/no/such/program",)))
    assert isinstance(finished, Finished)
    assert finished.exit_code == ExitCode.ENVIRONMENT
    assert "cannot start a process" in finished.detail


def test_a_node_that_is_not_quiet_refuses_before_anything_starts() -> None:
    busy = NodeState(cores=2, usable_cores=2, cores_had=1.0, busy_cores=2.0, stolen=0.0)
    messages = list(node.measure(request(FAILS, Limits()), calibrate=lambda: busy))
    assert messages == [Refused("others keep 2.0 of 2 cores busy, of which 2 are usable")]


def test_what_needs_no_quiet_machine_is_not_calibrated() -> None:
    def calibrate() -> NodeState:
        raise AssertionError

    assert len(list(node.measure(request(FAILS), calibrate=calibrate))) == 2


def started_with(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    asked: Request,
    *carried: model_files.CarriedModel,
) -> tuple[list[str], str, dict[str, str]]:
    """Return what a command starts with: its arguments, its folder and its environment."""
    import json

    monkeypatch.setenv("START_FILE", str(tmp_path / "start.json"))
    list(node.measure(asked, *carried, calibrate=lambda: QUIET))
    arguments, folder, environment = json.loads((tmp_path / "start.json").read_text())
    return arguments, folder, environment


def test_a_timed_command_waits_for_others_and_a_count_does_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    arguments, folder, _ = started_with(monkeypatch, tmp_path, request(DESCRIBES, Limits()))
    assert arguments == [
        "instructions",
        "--release",
        "4.0.0",
        "--results",
        "runs",
        "--wait",
        "--",
        "pile",
    ]
    assert not Path(folder).exists(), "its folder is gone"
    arguments, _, _ = started_with(monkeypatch, tmp_path, request(DESCRIBES))
    assert "--wait" not in arguments


def test_the_environment_is_that_of_the_node_and_not_of_ray(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RAY_JOB_ID", "1")
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.setenv("PYTHONPATH", "/elsewhere")
    _, _, environment = started_with(monkeypatch, tmp_path, request(DESCRIBES, label="epyc"))
    assert "RAY_JOB_ID" not in environment
    assert environment["OMP_NUM_THREADS"] == "3"
    assert environment["MJBENCH_MACHINE"] == "epyc"
    root = str(Path(node.__file__).resolve().parents[2])
    assert environment["PYTHONPATH"] == f"{root}{os.pathsep}/elsewhere"
    assert carried_models.VARIABLE not in environment


def test_a_machine_without_a_label_keeps_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MJBENCH_MACHINE", "own")
    _, _, environment = started_with(monkeypatch, tmp_path, request(DESCRIBES))
    assert environment["MJBENCH_MACHINE"] == "own"


def test_the_users_models_are_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pile.xml").write_text(CONTACT_XML)
    carried = model_files.carry(ModelSource("pile", tmp_path / "pile.xml"))
    _, _, environment = started_with(monkeypatch, tmp_path, request(DESCRIBES), carried)
    assert Path(environment[carried_models.VARIABLE]).name == "models.json"


def hanging() -> tuple[Iterator[Message], int]:
    """Return the messages of a command that hangs, and a pidfd of its process."""
    before = process_tree.descendants()
    messages = iter(node.measure(request(HANGS)))
    assert next(messages) == Began()
    (pid,) = process_tree.descendants() - before
    return messages, os.pidfd_open(pid)


def test_a_command_ends_when_nobody_waits_for_it() -> None:
    messages, process = hanging()
    messages.close()  # type: ignore[attr-defined]
    assert process_tree.ends(process)


def test_a_command_ends_when_its_node_is_lost() -> None:
    lost: list[bool] = []
    before = process_tree.descendants()
    messages = node.measure(request(HANGS), is_lost=lambda: bool(lost))
    assert next(iter(messages)) == Began()
    (pid,) = process_tree.descendants() - before
    process = os.pidfd_open(pid)
    lost.append(True)
    (finished,) = messages
    assert isinstance(finished, Finished)
    assert finished.detail == "this process is no longer part of a cluster"
    assert process_tree.ends(process)


def test_mjbench_itself_runs_and_ends_with_a_wrong_name() -> None:
    line = CommandLine(("compare", "--budget", "1s"), ("no_such_model",))
    began, finished = node.measure(Request(line), calibrate=lambda: QUIET)
    assert began == Began()
    assert isinstance(finished, Finished)
    assert finished.exit_code == ExitCode.USAGE
    assert finished.detail.startswith("no model 'no_such_model'")


def test_a_node_says_what_it_is() -> None:
    answer = node.describe()
    assert answer.machine.usable_cores >= 1
    assert answer.software.mjbench
