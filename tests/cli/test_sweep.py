"""`mjbench sweep` as a user types it: what it measures, keeps, and leaves when it is stopped."""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import process_tree
import psutil
import pytest
from commands import PYTHONPATH, mjbench
from example_models import CONTACT_XML
from sweep_examples import MACHINE, FakeCluster, node, plan_file

from mjbench import extras
from mjbench.cli.sweep import check_command
from mjbench.comparison.records import ModelRecord
from mjbench.errors import Failure
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import run_set
from mjbench.store.run_set import RunSection, RunSetFile
from mjbench.sweep import matrix, ray_cluster, results, software
from mjbench.sweep import plan as plans
from mjbench.sweep.ray_cluster import Refused

needs_ray = pytest.mark.skipif(bool(extras.missing(["ray"])), reason="Ray is not installed")
ANYTHING = "[nodes]\nmin-cores = 0\nmax-busy = 100\nmax-stolen = 100\n"
COMPARE = '[compare]\npaths = "rollout"\nthreads = 1\nnbatch = 4\nnstep = 20\n'
SET = "results/sweeps/plan.jsonl"


def write_plan(folder: Path, models: str, budget: str = "budget = 0.1\n") -> None:
    plan_file(folder, f"models = [{models}]\n{COMPARE}{budget}{ANYTHING}")


def sections(folder: Path) -> list[RunSection]:
    return list(run_set.read(folder / SET, RECORD_TYPES).sections)


def test_a_dry_run_says_what_there_is_to_do_and_measures_nothing(tmp_path: Path) -> None:
    plan_file(
        tmp_path,
        'models = ["cartpole", "pile"]\nreleases = ["3.3.0", "4.0.0"]\n'
        "[versions]\n[compare]\n[instructions]\n[history]\n",
    )
    done = mjbench("sweep", "plan.toml", "--dry-run", "--json", "-", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["results"]
    assert len(rows) == 12
    assert {row["status"] for row in rows} == {None}
    assert "versions cartpole 3.3.0 → 4.0.0 python_loop" in done.stderr
    first = done.stderr.splitlines()[1]
    assert first == "12 results, 12 of them missing: mjbench sweep plan.toml --json -"
    assert list(tmp_path.iterdir()) == [tmp_path / "plan.toml"]


@pytest.mark.parametrize(
    ("text", "arguments", "code", "message"),
    [
        ("models = 3\n[compare]", [], 2, "plan.toml, line 1: models: give a list of texts"),
        ('models = ["broken.xml"]\n[compare]', [], 2, "broken.xml: MuJoCo cannot load it"),
        ("[compare]", ["-o", "plan.toml"], 2, "not a run set"),
        ("[compare]", ["-o", "notes.txt"], 2, "not a run set"),
        ("[compare]", ["-o", "/proc/set.jsonl"], 3, "cannot write /proc/set.jsonl"),
        ("[compare]", ["-o", "x" * 300], 3, f"cannot write {'x' * 300}: File name too long"),
        ("[compare]", ["--address", "ray://a:1"], 2, "run mjbench on a machine of the cluster"),
        ("[compare]", ["--address", "127.0.0.1:1"], 3, "no cluster of Ray at 127.0.0.1:1: Connec"),
        ("[compare]", ["--address", "nowhere"], 3, "no cluster of Ray at nowhere: "),
    ],
)
def test_what_cannot_be_measured_is_one_line(
    tmp_path: Path, text: str, arguments: list[str], code: int, message: str
) -> None:
    if "--address" in arguments and extras.missing(["ray"]):
        pytest.skip("Ray is not installed")
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    (tmp_path / "notes.txt").write_text("not a run set\n")
    plan_file(tmp_path, text)
    done = mjbench("sweep", "plan.toml", *arguments, cwd=tmp_path)
    assert done.returncode == code
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "notes.txt").read_text() == "not a run set\n"
    assert (tmp_path / "plan.toml").read_text() == text
    assert not (tmp_path / SET).exists()


def store_first(folder: Path) -> RunSection:
    """Have the run set hold the plan's first cell; return its section."""
    plan = plans.load(folder / "plan.toml", check_command)
    cell, _ = matrix.build(plan, software.installed()).cells
    result = results.failed(cell, Failure(Status.OK, ""), MACHINE)
    (folder / SET).parent.mkdir(parents=True)
    file = RunSetFile.create(folder / SET)
    file.append(result.section)
    file.close()
    return result.section


@needs_ray
def test_a_sweep_measures_what_is_missing_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/own.xml").write_text(CONTACT_XML)
    write_plan(tmp_path, '"cartpole", "robots/own.xml"')
    store_first(tmp_path)
    before = (tmp_path / SET).read_bytes()
    first = mjbench("sweep", "plan.toml", cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    assert first.stderr == ""
    assert f"mjbench show {SET} --html" in first.stdout
    assert (tmp_path / SET).read_bytes().startswith(before)
    _, measured = sections(tmp_path)
    assert measured.run.header.command == "compare"
    assert results.outcome(measured.run).status == Status.OK
    models = [record.model for record in measured.run.of_type(ModelRecord)]
    assert models == ["robots/own.xml"], "by its name in the plan"

    after = (tmp_path / SET).read_bytes()
    again = mjbench("sweep", "plan.toml", "--json", "out.json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    assert [(row["model"], row["status"]) for row in rows] == [
        ("cartpole", "ok"),
        ("robots/own.xml", "ok"),
    ]
    assert "The run set has all results of the plan; nothing was measured." in again.stdout
    assert (tmp_path / SET).read_bytes() == after


class BusyCluster(FakeCluster):
    """A cluster whose only node is always busy."""

    def __init__(self, *arguments: object):
        super().__init__([node("one")], lambda request: [Refused(request, "one: it is busy")])

    def __enter__(self) -> "BusyCluster":
        return self

    def __exit__(self, *exception: object) -> None: ...


def test_without_a_quiet_node_it_ends_with_the_reasons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ray_cluster, "RayCluster", BusyCluster)
    never = "[nodes]\npatience = 0\nmin-cores = 100\nmax-busy = 0\nmax-stolen = 0\n"
    plan_file(tmp_path, f'models = ["cartpole"]\n{COMPARE}{never}')
    done = mjbench("sweep", "plan.toml", cwd=tmp_path)
    assert done.returncode == 3
    assert "1 of 1 results are missing: one: it is busy" in done.stderr
    assert sections(tmp_path) == []


def is_measuring(process: psutil.Process) -> bool:
    """Return whether a process is not Ray's own: its agents end a minute after a killed node."""
    name = " ".join(process.cmdline())
    return "/ray/" not in name and (not name.startswith("ray::") or "measure" in name)


def wait_for_command(folder: Path, process: "subprocess.Popen[str]") -> None:
    """Wait until a command on a node has begun its run file."""
    while process.poll() is None and not list(folder.glob("mjbench-*/*/runs/*.jsonl")):
        threading.Event().wait(0.05)


@needs_ray
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])  # Ray has its own SIGTERM
def test_stopped_it_keeps_what_was_measured_and_leaves_no_process(
    tmp_path: Path, number: signal.Signals
) -> None:
    write_plan(tmp_path, '"cartpole", "pile"', budget="budget = 600\n")
    first = store_first(tmp_path)
    before = process_tree.descendants()
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", "sweep", "plan.toml"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for_command(tmp_path, process)
    started = [psutil.Process(pid) for pid in process_tree.descendants() - before]
    below = [os.pidfd_open(one.pid) for one in started if is_measuring(one)]
    assert len(below) >= 3, "mjbench here, the one of the node, and its child"
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == (-number if number == signal.SIGKILL else 130)
    assert "Traceback" not in errors
    if number != signal.SIGKILL:
        assert "interrupted; what was measured is saved" in errors
    assert all(process_tree.ends(descriptor) for descriptor in below)
    assert [(one.cell, one.lines) for one in sections(tmp_path)] == [(first.cell, first.lines)]
