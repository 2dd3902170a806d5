"""Sweeps on two nodes of Ray that run here; one of them is killed while it measures.

    python ray_sweep.py FOLDER

Prints a JSON object: `cells`, how often the run set has each cell; `statuses` of them; `nodes`, the
names of those that delivered something; `killed`, whether one was killed while it measured.
"""

import json
import os
import signal
import sys
import threading
from collections import Counter
from pathlib import Path

import psutil
from sweep_examples import count_cell, matrix

from mjbench.instrument import run_set
from mjbench.instrument.run_set import RunSetFile
from mjbench.report.documents import RECORD_TYPES
from mjbench.sweep.ray_cluster import RESOURCE, RayCluster
from mjbench.sweep.results import CellResult
from mjbench.sweep.run import Sweep

MODELS = ("a", "b", "c")
RELEASES = ("3.3.0", "3.5.0", "4.0.0")
STUB = Path(__file__).with_name("stub_command.py")


def main() -> None:
    from ray.cluster_utils import Cluster

    folder = Path(sys.argv[1])
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    cells = [count_cell(model, release) for model in MODELS for release in RELEASES]
    (folder / "hang-b").touch()
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    nodes = [cluster.add_node(num_cpus=1, resources={RESOURCE: 1}) for _ in range(2)]
    pids = [node.all_processes["raylet"][0].process.pid for node in nodes]
    target = folder / "set.jsonl"
    file = RunSetFile.create(target)

    def store(result: CellResult) -> None:
        file.append(result.section)

    killer = threading.Thread(target=kill_the_hanging, args=(folder, pids), daemon=True)
    with RayCluster(cluster.address) as ray_cluster:
        program = (sys.executable, str(STUB), str(folder))
        sweep = Sweep(matrix(cells), (), ray_cluster, store, RECORD_TYPES, program=program)
        sweep.take_nodes(ray_cluster.ask_nodes())
        killer.start()
        summary = sweep.measure()
    cluster.shutdown()
    sections = run_set.read(target, RECORD_TYPES).sections
    counts = Counter(section.cell for section in sections)
    answer = {
        "cells": {cell.key: counts[cell.key] for cell in cells},
        "statuses": sorted({r.outcome.status for r in summary.results}),
        "delivered": [record.cells for record in summary.nodes],
        "gone": [record.reason for record in summary.nodes if not record.is_there],
        "killed": (folder / "killed").exists(),
    }
    print(json.dumps(answer))


def kill_the_hanging(folder: Path, raylets: list[int]) -> None:
    """Kill the raylet below which the command hangs, as soon as it does."""
    while not (folder / "hanging-b").exists():
        threading.Event().wait(0.05)
    for pid in raylets:
        below = psutil.Process(pid).children(recursive=True)
        if any(process.cmdline()[-1:] == ["b"] for process in below):
            os.kill(pid, signal.SIGKILL)
            (folder / "killed").touch()


if __name__ == "__main__":
    main()
