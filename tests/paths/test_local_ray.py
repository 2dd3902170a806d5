"""Ray runs on this machine alone while somebody uses it, and no process of it lives on."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import process_tree
import pytest
from commands import PYTHONPATH, TESTS
from isolated_tasks import Process, Text, step_with_ray
from mjbench.sweep.ray_cluster import LOCAL

from mjbench import paths
from mjbench.errors import MachineError
from mjbench.host import isolate
from mjbench.paths import local_ray
from mjbench.paths.ray_actors import Ray
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.sweep import ray_cluster

pytestmark = pytest.mark.skipif(Ray().unavailable() is not None, reason=str(Ray().unavailable()))


def test_ray_is_local_whatever_the_environment_says_and_ends_with_its_last_user(
    small: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "192.0.2.99:6379")
    before = process_tree.descendants()
    handler = signal.getsignal(signal.SIGTERM)
    running = []
    for _ in range(2):
        resources = paths.Resources(small)
        Ray().prepare(small, {"actors": 2}, resources).run()
        running.append(resources)
    assert process_tree.descendants() > before
    running[0].close()
    assert process_tree.descendants() > before
    running[1].close()
    assert process_tree.descendants() <= before
    assert os.environ["RAY_ADDRESS"] == "192.0.2.99:6379"
    assert "RAY_AUTH_TOKEN" not in os.environ
    assert signal.getsignal(signal.SIGTERM) is handler


def test_a_folder_whose_name_is_too_long_for_sockets_is_a_failure_of_one_line(
    tmp_path: Path, small: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / ("long" * 20)
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    with pytest.raises(MachineError, match=r"a temporary folder with a shorter name .* TMPDIR"):
        Ray().prepare(small, {"actors": 2}, paths.Resources(small))


def test_ray_ends_with_a_child_that_leaves_it_behind() -> None:
    descriptors: list[int] = []

    def watch(message: Process) -> None:
        descriptors.append(os.pidfd_open(message.pid))

    ended = isolate.run(step_with_ray, (Text("7"),), watch, 60.0, str(TESTS))
    assert ended.status == Status.CRASHED
    assert len(descriptors) > 4
    assert all(map(process_tree.ends, descriptors))


def test_ray_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = (
        "from isolated_tasks import Text, step_with_ray\n"
        "from mjbench.host import isolate\n"
        "isolate.run(step_with_ray, (Text(''),), lambda message:"
        f" print(getattr(message, 'pid', 0), flush=True), 60.0, {str(TESTS)!r})"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
    )
    assert parent.stdout is not None
    descriptors = [
        os.pidfd_open(pid) for line in iter(parent.stdout.readline, "0\n") if (pid := int(line))
    ]
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert len(descriptors) > 4
    assert all(map(process_tree.ends, descriptors))


@pytest.fixture
def no_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray was not imported yet, and there is no secret."""
    monkeypatch.setattr(local_ray, "_secret", {})
    monkeypatch.delitem(sys.modules, "ray", raising=False)
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    monkeypatch.delenv("RAY_AUTH_TOKEN", raising=False)


@pytest.mark.usefixtures("no_ray")
def test_the_secret_is_in_the_environment_for_the_block_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "a cluster")
    with local_ray.secret_environment({"RAY_ADDRESS": None}):
        first = os.environ["RAY_AUTH_TOKEN"]
        assert len(first) == 64
        assert os.environ["RAY_AUTH_MODE"] == "token"
        assert "RAY_ADDRESS" not in os.environ
    assert "RAY_AUTH_TOKEN" not in os.environ
    assert os.environ["RAY_ADDRESS"] == "a cluster"


@pytest.mark.usefixtures("no_ray")
@pytest.mark.parametrize(("address", "mode"), [(LOCAL, "token"), ("10.0.0.1:6379", None)])
def test_a_sweep_starts_ray_with_the_secret_and_joins_other_clusters_without(
    monkeypatch: pytest.MonkeyPatch, address: str, mode: str | None
) -> None:
    modes = []
    monkeypatch.setattr(
        ray_cluster, "_start", lambda *_, **__: modes.append(os.environ.get("RAY_AUTH_MODE"))
    )
    with contextlib.ExitStack() as closing:
        ray_cluster._connect(address, closing)
    assert modes == [mode]
