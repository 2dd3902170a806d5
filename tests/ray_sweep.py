"""A sweep on two nodes of Ray that run here; one of them is killed, and the head is left out.

    python ray_sweep.py FOLDER

The run set is FOLDER/set.jsonl. Prints a JSON object: `keys` of all cells; `statuses` that they
ended with; `delivered`, how many results each node delivered; `killed`, whether one was killed.
"""

import json
import os
import signal
import sys
import threading
from pathlib import Path

import psutil
from sweep_examples import count_cell, matrix

from mjbench.store.run_set import RunSetFile
from mjbench.sweep.ray_cluster import LABEL, RESOURCE, LeftOut, RayCluster
from mjbench.sweep.results import CellResult
from mjbench.sweep.run import Sweep

MODELS = ("a", "b", "c")
RELEASES = ("3.3.0", "3.5.0", "4.0.0")
STUB = Path(__file__).with_name("stub_command.py")


def main() -> None:
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    from ray.cluster_utils import Cluster

    folder = Path(sys.argv[1])
    cells = [count_cell(model, release) for model in MODELS for release in RELEASES]
    (folder / "hang-b").touch()
    measures = {"num_cpus": 1, "resources": {RESOURCE: 1}}
    cluster = Cluster(initialize_head=True, head_node_args={**measures, "labels": {LABEL: "other"}})
    nodes = [cluster.add_node(**measures) for _ in range(2)]
    raylets = [node.all_processes["raylet"][0].process.pid for node in nodes]
    file = RunSetFile.create(folder / "set.jsonl")

    def store(result: CellResult, node: str, ndone: int) -> None:
        file.append(result.section)

    killer = threading.Thread(target=kill_where_it_hangs, args=(folder, raylets), daemon=True)
    with RayCluster(cluster.address) as ray_cluster:
        program = (sys.executable, str(STUB), str(folder))
        others = [one for one in ray_cluster.nodes if one.label == "other"]
        ray_cluster.nodes = tuple(one for one in ray_cluster.nodes if one not in others)
        ray_cluster.left_out = tuple(LeftOut(one.id, one.name, "other software") for one in others)
        sweep = Sweep(matrix(cells), (), ray_cluster, store, program=program)
        killer.start()
        summary = sweep.measure()
    cluster.shutdown()
    answer = {
        "keys": [cell.key for cell in cells],
        "statuses": sorted({outcome.status for outcome in summary.outcomes.values()}),
        "delivered": sorted(record.cells for record in summary.nodes),
        "killed": (folder / "killed").exists(),
    }
    print(json.dumps(answer))


def kill_where_it_hangs(folder: Path, raylets: list[int]) -> None:
    """Kill the raylet below which a command hangs, when all that it measured was delivered."""
    while (
        not (folder / "hanging-b").exists()
        or b'"instructions b 3.5.0' not in (folder / "set.jsonl").read_bytes()
    ):
        threading.Event().wait(0.05)
    for pid in raylets:
        if any(last_argument(process) == "b" for process in psutil.Process(pid).children(True)):
            (folder / "killed").touch()
            os.kill(pid, signal.SIGKILL)


def last_argument(process: psutil.Process) -> str | None:
    """Return the last argument of a process; None where it has ended meanwhile."""
    try:
        return process.cmdline()[-1]
    except (psutil.Error, IndexError):
        return None


if __name__ == "__main__":
    main()
