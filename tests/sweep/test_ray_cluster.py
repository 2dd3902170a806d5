"""On Ray itself: a node that is killed loses no cell, and what goes wrong is one line."""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from commands import PYTHONPATH, ROOT, TESTS
from sweep_examples import MACHINE

from mjbench.errors import InputError, MachineError
from mjbench.instrument import extras, run_set
from mjbench.report.documents import RECORD_TYPES
from mjbench.sweep import ray_cluster, software
from mjbench.sweep.executor import Left, LeftOut
from mjbench.sweep.messages import NodeAnswer
from mjbench.sweep.ray_cluster import RayCluster, _RayNode

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
    assert all(answer["delivered"]), "both nodes measured"
    assert "raylet" not in done.stdout, "what Ray has to say is not the user's"


def node(cpus: float = 4.0, **resources: float) -> _RayNode:
    return _RayNode("id", "10.0.0.1", "name", {"CPU": cpus, **resources}, {})


def listed(name: str, **resources: float) -> dict[str, object]:
    """Return a node as Ray lists it."""
    node_id = name.encode().hex().ljust(56, "0")
    return {"NodeID": node_id, "Alive": True, "NodeManagerHostname": name, "Resources": resources}


def names(cluster: RayCluster) -> list[str]:
    """Return the names of the nodes that are asked what they are."""
    return [node.name.partition(" ")[0] for node in cluster._known.values()]


class Asking:
    """Stands for a function of Ray: it notes on which nodes it is to run."""

    def options(self, **options: object) -> "Asking":
        return self

    def remote(self) -> object:
        return object()


@needs_ray
def test_nodes_that_declare_the_resource_measure_and_no_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import ray

    nodes = [listed("plain", CPU=4.0), listed("head", CPU=0.0)]
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    cluster = RayCluster()
    cluster._describe = Asking()  # type: ignore[attr-defined]
    cluster._read_nodes()
    assert names(cluster) == ["plain"], "in a cluster where none declares it"

    cluster = RayCluster()
    cluster._describe = Asking()  # type: ignore[attr-defined]
    nodes.append(listed("declaring", CPU=4.0, mjbench=1.0))
    cluster._read_nodes()
    assert names(cluster) == ["declaring"]
    gone = str(nodes.pop()["NodeID"])
    cluster._read_nodes()
    assert names(cluster) == [], "also when it is gone"
    assert cluster._events == [Left(gone, "it is gone")]


@needs_ray
def test_a_node_that_is_gone_before_its_answer_comes_gets_no_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import ray

    nodes = [listed("brief", CPU=4.0)]
    answer = NodeAnswer(software.installed(), MACHINE)
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    monkeypatch.setattr(ray, "get", lambda reference, timeout: answer)
    cluster = RayCluster()
    cluster._describe = Asking()  # type: ignore[attr-defined]
    cluster._read_nodes()
    (reference,) = cluster._asked
    nodes.clear()
    cluster._read_nodes()
    cluster._take_answer(reference)
    assert [type(event) for event in cluster._events] == [Left, LeftOut]


@pytest.mark.parametrize(
    ("of", "share", "taken"),
    [
        (node(mjbench=1), 1.0, {"num_cpus": 0, "resources": {"mjbench": 1}}),
        (node(mjbench=2), 1.0, {"num_cpus": 0, "resources": {"mjbench": 2}}),
        (node(mjbench=1), 1 / 4, {"num_cpus": 0, "resources": {"mjbench": 0.25}}),
        (node(mjbench=1), 1 / 3, {"num_cpus": 0, "resources": {"mjbench": 0.3333}}),
        (node(cpus=64), 1.0, {"num_cpus": 64}),
        (node(cpus=64), 1 / 64, {"num_cpus": 1}),
    ],
)
def test_a_measurement_of_time_takes_all_of_a_node(
    of: _RayNode, share: float, taken: dict[str, object]
) -> None:
    actual = ray_cluster._share(of, share)
    assert actual["num_cpus"] == taken["num_cpus"]
    assert actual.get("resources", {}) == pytest.approx(taken.get("resources", {}))


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
