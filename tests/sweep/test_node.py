"""A node runs a command, sends its cells as they come, and leaves nothing behind."""

import json
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import process_tree
import pytest
from example_models import CONTACT_XML
from sweep_examples import MACHINE, count_cell

from mjbench.errors import Failure
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.sweep import model_files, node, software
from mjbench.sweep.busy_node import NodeRules, NodeState
from mjbench.sweep.cells import Cell, CellKind
from mjbench.sweep.commands import CommandLine
from mjbench.sweep.node import BusyError, NodeMeasurement, NotMeasuredError, Request

STUB = Path(__file__).parents[1] / "stub_command.py"
CELLS = tuple(count_cell("pile", release) for release in ("3.3.0", "3.5.0", "4.0.0"))
LINE = CommandLine(("instructions", *(f"--release={c.release}" for c in CELLS)), ("pile",))
QUIET = NodeState(cores=2, usable_cores=2, cores_had=2.0, busy_cores=0.0, stolen=0.0)
BUSY = NodeState(cores=2, usable_cores=2, cores_had=1.0, busy_cores=2.0, stolen=0.0)
OBJECTION = "others keep 2.0 of 2 cores busy, of which 2 are usable"
FAILS = "import sys; print('mjbench: the disk is full', file=sys.stderr); sys.exit(3)"
DESCRIBES = """
import json, os, pathlib, sys
start = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)])
pathlib.Path(os.environ["START_FILE"]).write_text(start)
sys.exit(2)
"""


def request(
    *program: str,
    cells: tuple[Cell, ...] = CELLS,
    line: CommandLine = LINE,
    rules: NodeRules | None = None,
) -> Request:
    return Request(cells, line, software.installed(), rules, program)


def python(code: str, rules: NodeRules | None = None) -> Request:
    """Return a request whose command is a program."""
    return request(sys.executable, "-c", code, rules=rules)


def measure(
    asked: Request, calibrate: Callable[[], NodeState] = lambda: QUIET
) -> list[NodeMeasurement]:
    return list(node.measure(asked, calibrate=calibrate, sleep=lambda seconds: None))


def failure(asked: Request) -> Failure:
    """Return how a request fails."""
    with pytest.raises(NotMeasuredError) as caught:
        measure(asked)
    return caught.value.failure


def stub(folder: Path) -> Request:
    line = CommandLine(
        ("instructions", *(text for c in CELLS for text in ("--release", c.release))), ("pile",)
    )
    return request(sys.executable, str(STUB), str(folder), line=line)


def test_the_cells_of_a_command_come_in_their_order(tmp_path: Path) -> None:
    measured = measure(stub(tmp_path))
    assert [one.result.cell for one in measured] == list(CELLS)
    assert {one.result.outcome.status for one in measured} == {Status.OK}


def test_lines_that_are_no_run_file_are_the_commands_failure() -> None:
    writes = """
import pathlib, sys
folder = pathlib.Path(sys.argv[sys.argv.index("--results") + 1])
folder.mkdir()
(folder / "run.jsonl").write_text("header\\nfirst\\n")
"""
    assert "what the node measured" in failure(python(writes)).detail


def test_a_command_that_fails_says_why() -> None:
    assert failure(python(FAILS)) == Failure(Status.FAILED, "the disk is full")


def test_a_command_that_is_killed_has_crashed() -> None:
    killed = failure(python("import os; os.kill(os.getpid(), 9)"))
    assert killed == Failure(Status.CRASHED, "killed by signal 9 (SIGKILL)")


def test_a_program_that_cannot_start_is_the_nodes_failure() -> None:
    assert "cannot start a process" in failure(request("/no/such/program")).detail


def test_a_node_with_other_software_measures_nothing() -> None:
    other = replace(software.installed(), python="3.0")
    assert failure(replace(python(FAILS), software=other)).detail.startswith("Python ")


def test_a_failure_travels_from_node_to_driver() -> None:
    failure = Failure(Status.FAILED, "the disk is full")
    error = pickle.loads(pickle.dumps(NotMeasuredError(failure, MACHINE)))
    assert (error.failure, error.machine) == (failure, MACHINE)


def test_a_node_waits_until_it_is_quiet_and_says_for_how_long(tmp_path: Path) -> None:
    states = iter([BUSY, BUSY, QUIET])
    rules = NodeRules(patience_s=60.0)
    first, *others = measure(replace(stub(tmp_path), rules=rules), lambda: next(states))
    assert (first.busy_s, first.objection) == (30.0, OBJECTION)
    assert {(one.busy_s, one.objection) for one in others} == {(0.0, "")}


def test_a_node_that_stays_busy_starts_nothing() -> None:
    with pytest.raises(BusyError, match=OBJECTION):
        measure(python(FAILS, NodeRules(patience_s=60.0)), lambda: BUSY)


def test_what_needs_no_quiet_machine_is_not_calibrated() -> None:
    def calibrate() -> NodeState:
        raise AssertionError

    with pytest.raises(NotMeasuredError, match="the disk is full"):
        measure(python(FAILS), calibrate)


def started_with(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    asked: Request,
    *carried: model_files.CarriedModel,
    label: str = "",
) -> tuple[list[str], str, dict[str, str]]:
    """Return what a command starts with: its arguments, its folder and its environment."""
    monkeypatch.setenv("START_FILE", str(tmp_path / "start.json"))
    list(node.measure(asked, *carried, label=label, calibrate=lambda: QUIET))
    arguments, folder, environment = json.loads((tmp_path / "start.json").read_text())
    return arguments, folder, environment


def test_a_timed_command_waits_for_others_and_a_count_does_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    arguments, folder, _ = started_with(
        monkeypatch, tmp_path, python(DESCRIBES, NodeRules(patience_s=0.0))
    )
    assert arguments == [
        "instructions",
        *LINE.arguments[1:],
        "--results",
        "runs",
        "--wait",
        "--",
        "pile",
    ]
    assert not Path(folder).exists(), "its folder is gone"
    arguments, _, _ = started_with(monkeypatch, tmp_path, python(DESCRIBES))
    assert "--wait" not in arguments


def test_the_environment_is_that_of_the_node_and_not_of_ray(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RAY_JOB_ID", "1")
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.setenv("PYTHONPATH", "/elsewhere")
    _, _, environment = started_with(monkeypatch, tmp_path, python(DESCRIBES), label="epyc")
    assert "RAY_JOB_ID" not in environment
    assert environment["OMP_NUM_THREADS"] == "3"
    assert environment["MJBENCH_MACHINE"] == "epyc"
    root = str(Path(node.__file__).resolve().parents[2])
    assert environment["PYTHONPATH"] == f"{root}{os.pathsep}/elsewhere"
    assert models.CARRIED_VARIABLE not in environment


def test_a_machine_without_a_label_keeps_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MJBENCH_MACHINE", "own")
    _, _, environment = started_with(monkeypatch, tmp_path, python(DESCRIBES))
    assert environment["MJBENCH_MACHINE"] == "own"


def test_the_users_models_are_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pile.xml").write_text(CONTACT_XML)
    carried = model_files.carry(ModelSource("pile", tmp_path / "pile.xml"))
    _, _, environment = started_with(monkeypatch, tmp_path, python(DESCRIBES), carried)
    assert Path(environment[models.CARRIED_VARIABLE]).name == "models.json"


def test_a_command_ends_when_nobody_waits_for_it(tmp_path: Path) -> None:
    (tmp_path / "hang-pile").touch()
    before = process_tree.descendants()
    measured: Iterator[NodeMeasurement] = node.measure(stub(tmp_path))
    assert next(measured).result.cell == CELLS[0]
    (pid,) = process_tree.descendants() - before
    process = os.pidfd_open(pid)
    measured.close()  # type: ignore[attr-defined]
    assert process_tree.ends(process)


def test_a_command_line_that_is_wrong_on_every_node_is_its_cells_result() -> None:
    cell = Cell(CellKind.COMPARE, "no_such_model")
    line = CommandLine(("compare", "--budget", "1s"), ("no_such_model",))
    (measured,) = measure(request(cells=(cell,), line=line))
    assert measured.result.outcome.status == Status.INPUT
    assert measured.result.outcome.detail.startswith("no model 'no_such_model'")


def test_a_node_says_what_it_is() -> None:
    there, machine = node.describe()
    assert machine.usable_cores >= 1
    assert there.mjbench
