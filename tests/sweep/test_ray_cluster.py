"""On Ray itself: a node that is killed loses no cell, and what goes wrong is one line."""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from commands import PYTHONPATH, ROOT, TESTS

from mjbench.errors import InputError, MachineError
from mjbench.instrument import extras, run_set
from mjbench.report.documents import RECORD_TYPES
from mjbench.sweep import ray_cluster
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


def test_nodes_that_declare_the_resource_are_those_that_measure() -> None:
    plain, declaring = node(), node(mjbench=1)
    assert ray_cluster._usable([plain, declaring]) == [declaring]
    assert ray_cluster._usable([plain, node(cpus=0)]) == [plain]


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
