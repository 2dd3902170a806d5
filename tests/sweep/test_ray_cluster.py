"""On Ray itself: a node that is killed loses no cell, and what goes wrong is one line."""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from commands import PYTHONPATH, ROOT, TESTS
from sweep_examples import MACHINE, verdict_cell

from mjbench import extras
from mjbench.errors import Failure, InputError, MachineError
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import run_set
from mjbench.sweep import ray_cluster, software
from mjbench.sweep.commands import CommandLine
from mjbench.sweep.node import BusyError, NotMeasuredError, Request
from mjbench.sweep.ray_cluster import LABEL, Failed, LeftOut, RayCluster, Refused

needs_ray = pytest.mark.skipif(bool(extras.missing(["ray"])), reason="Ray is not installed")


@needs_ray
def test_of_two_nodes_one_is_killed_and_every_cell_is_measured_once(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(TESTS / "ray_sweep.py"), str(tmp_path)],
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout.splitlines()[-1])
    assert answer["killed"]
    sections = run_set.read(tmp_path / "set.jsonl", RECORD_TYPES).sections
    assert Counter(section.cell for section in sections) == dict.fromkeys(answer["keys"], 1)
    assert answer["statuses"] == ["ok"]
    assert sum(answer["delivered"]) == len(answer["keys"])
    assert len(answer["delivered"]) == 2, "and none that is left out"
    assert all(answer["delivered"]), "both nodes measured"
    assert "raylet" not in done.stdout, "what Ray has to say is not the user's"


def listed(name: str, label: str = "", is_alive: bool = True, **resources: float) -> dict[str, Any]:
    """Return a node as Ray lists it."""
    labels = {LABEL: label} if label else {}
    resources = {"CPU": 4.0, **resources}
    return {"NodeID": name, "Alive": is_alive, "Labels": labels, "Resources": resources}


@needs_ray
def test_only_nodes_that_are_alive_and_declare_the_resource_measure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import ray

    nodes = [
        listed("plain"),
        listed("declaring", mjbench=1.0),
        listed("gone", is_alive=False, mjbench=1.0),
        listed("head", mjbench=1.0, CPU=0.0),
    ]
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    assert [one["NodeID"] for one in ray_cluster._listed()] == ["declaring"]


@needs_ray
@pytest.mark.parametrize(
    ("machines", "nodes", "is_possible"),
    [
        (["epyc"], [listed("a", "epyc", mjbench=1.0)], True),
        (["epyc"], [listed("a", "xeon", mjbench=1.0)], False),
        (["xeon", "epyc"], [listed("a", "epyc", mjbench=1.0)], True),
        ([""], [listed("a", "epyc", mjbench=1.0)], True),
        ([""], [listed("left out", mjbench=1.0)], False),
        ([""], [], False),
    ],
)
def test_a_sweep_ends_where_no_node_can_measure_what_is_left(
    monkeypatch: pytest.MonkeyPatch,
    machines: list[str],
    nodes: list[dict[str, Any]],
    is_possible: bool,
) -> None:
    import ray

    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    monkeypatch.setattr(ray, "wait", lambda tasks, **options: ([], tasks))
    cluster = RayCluster()
    cluster.left_out = (LeftOut("left out", "left out", "other software"),)
    cluster._running = {machine: request(machine) for machine in machines}
    assert cluster._is_possible() == is_possible
    if not is_possible:
        assert list(cluster.events(patience_s=0.0)) == []


def request(machine: str = "") -> Request:
    line = CommandLine(("versions",), ("pile",))
    cells = (verdict_cell("pile", machine=machine),)
    return Request(cells, line, software.installed())


@needs_ray
def test_why_a_task_ended_is_one_line() -> None:
    import ray

    def ended(cause: Exception) -> Failed | Refused:
        return ray_cluster._ended(request(), ray.exceptions.RayTaskError("measure", "", cause))

    full = Failure(Status.FAILED, "the disk is full")
    assert ended(NotMeasuredError(full, MACHINE)) == Failed(request(), full, MACHINE)
    assert ended(BusyError("others keep it busy")) == Refused(request(), "others keep it busy")
    assert ended(ValueError("no")) == Failed(request(), Failure(Status.CRASHED, "ValueError: no"))
    killed = ray_cluster._ended(request(), ray.exceptions.WorkerCrashedError())
    assert killed == Failed(request(), Failure(Status.CRASHED, "its worker was killed"))


def test_the_address_of_a_ray_client_is_refused() -> None:
    if extras.missing(["ray"]):
        pytest.skip("Ray is not installed")
    with (
        pytest.raises(InputError, match="run mjbench on a machine of the cluster"),
        RayCluster("ray://head:10001"),
    ):
        pass


def test_without_ray_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "_is_installed", lambda name: name != "ray")
    with (
        pytest.raises(MachineError, match="needs ray: python -m pip install"),
        RayCluster(),
    ):
        pass
