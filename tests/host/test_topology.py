"""Which cores a process may use, read from invented folders of the kernel."""

from pathlib import Path

import psutil
import pytest

from mjbench.host import topology
from mjbench.host.topology import Topology


def folders(system: Path, siblings: dict[int, str], nodes: dict[int, str]) -> Path:
    """Write the kernel's lists: the hardware threads of each one's core, and of each NUMA node."""
    for number, text in siblings.items():
        folder = system / f"cpu/cpu{number}/topology"
        folder.mkdir(parents=True)
        (folder / "thread_siblings_list").write_text(f"{text}\n")
    for number, text in nodes.items():
        folder = system / f"node/node{number}"
        folder.mkdir(parents=True)
        (folder / "cpulist").write_text(f"{text}\n")
    return system


@pytest.fixture(autouse=True)
def no_quota(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(topology, "cgroup_quota", lambda: None)


def test_hyper_threads_and_nodes_are_told_apart(tmp_path: Path) -> None:
    siblings = {0: "0,4", 4: "0,4", 1: "1,5", 5: "1,5", 2: "2,6", 6: "2,6", 3: "3,7", 7: "3,7"}
    system = folders(tmp_path, siblings, {0: "0-1,4-5", 1: "2-3,6-7"})
    read = topology.read(set(range(8)), system)
    assert read == Topology(hardware_threads=8, cores=4, node_sizes=(4, 4))
    assert read.thread_counts() == (1, 4, 8)
    # hardware threads that this process may not use do not count
    assert topology.read({0, 1, 2, 4}, system) == Topology(4, 3, (3, 1))


def test_what_the_kernel_does_not_say_is_unknown(tmp_path: Path) -> None:
    assert topology.read({0, 1}, tmp_path) == Topology(2, None, ())
    system = folders(tmp_path, {0: "0", 1: "what"}, {})
    assert topology.read({0, 1}, system).cores is None


def test_a_system_without_affinity_knows_numbers_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(psutil, "cpu_count", lambda logical: 3)
    monkeypatch.setattr(topology.os, "cpu_count", lambda: 6)
    assert topology.read(set()) == Topology(6, 3)


def test_threads_are_tried_where_something_changes() -> None:
    assert Topology(64, 32, (16,) * 4, 11.5).thread_counts() == (1, 11, 12)
    assert Topology(64, 32, (16,) * 4).thread_counts() == (1, 16, 32, 64)
    assert Topology(2, 2, (2,)).thread_counts() == (1, 2)
