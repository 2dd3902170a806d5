"""What does `mjbench sweep` cost beside the commands that it runs?

    python -m benchmarks.sweep_cost [--quick] [--rounds N] [--time-limit S]

measures the ten shipped models in four releases twice in each round: by hand, one command of
mjbench after the other, and by a sweep on one node of Ray that is started for it. The order changes
from round to round. Every verdict takes all of its time limit, so that both do equally much. The
overhead is by how much longer the sweep takes; beside it stand its parts.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.simulation import models

if TYPE_CHECKING:
    from mjbench.sweep.matrix import Matrix
    from mjbench.sweep.plan import Plan
    from mjbench.sweep.results import CellResult

RELEASES = ("3.3.0", "3.9.0", "3.17.0", "4.0.0")
QUICK_MODELS, QUICK_RELEASES = ("cartpole", "cube_table"), ("3.17.0", "4.0.0")
TIME_LIMIT_S, QUICK_TIME_LIMIT_S = 15.0, 3.0


@dataclass(frozen=True)
class SweepTimes:
    """Seconds of a sweep on one node.

    Attributes:
      start_s: until Ray ran, and the node had said what it is.
      command_s: in which commands ran, until their last result.
      other_s: starting workers, calibrating, and ending commands.
      stop_s: until Ray had ended.
    """

    start_s: float
    command_s: float
    other_s: float
    stop_s: float

    @property
    def total_s(self) -> float:
        """Seconds of all of it."""
        return self.start_s + self.command_s + self.other_s + self.stop_s


def plan_of(model_names: Sequence[str], versions: Sequence[str], time_limit_s: float) -> "Plan":
    """Return a plan whose verdicts all take their time limit, on nodes that never refuse."""
    from mjbench.paired.metrics import Metric
    from mjbench.releases.release_names import ReleaseSpec
    from mjbench.sweep.busy_node import Limits, NodeRules
    from mjbench.sweep.cells import CellKind
    from mjbench.sweep.plan import Plan

    releases = tuple(ReleaseSpec(version, version) for version in versions)
    options = ("--time-limit", f"{time_limit_s:g}", "--min-effect", "1e-4", "--precision", "1e-4")
    anything = Limits(min_cores=0.0, max_busy=1.0, max_stolen=1.0)
    return Plan(
        models=tuple(models.resolve(name) for name in model_names),
        releases=releases,
        pairs=tuple((releases[0], release) for release in releases[1:]),
        paths=("python_loop",),
        metrics=(Metric.TIME,),
        machines=(),
        options={CellKind.VERSIONS: options},
        rules=NodeRules(limits=anything),
    )


def by_hand(of: "Matrix") -> float:
    """Return the seconds of the commands that a sweep on one node runs, one after the other."""
    from mjbench.sweep import commands

    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        for cells in commands.batches(of.cells, {"": 1}):
            line = of.command_line(cells)
            arguments = [*line.arguments, "--results", folder, "--wait", "--", *line.operands]
            subprocess.run(
                [sys.executable, "-m", "mjbench", *arguments], check=True, stdout=subprocess.DEVNULL
            )
        return time.perf_counter() - begin


def by_sweep(of: "Matrix") -> SweepTimes:
    """Return the seconds of a sweep that does the same."""
    from mjbench.store.run_set import RunSetFile
    from mjbench.sweep.ray_cluster import RayCluster
    from mjbench.sweep.run import Sweep

    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        file = RunSetFile.create(Path(folder) / "set.jsonl")

        def store(result: "CellResult", node: str, ndone: int) -> None:
            file.append(result.section)

        with RayCluster() as cluster:
            sweep = Sweep(of, (), cluster, store)
            started = time.perf_counter()
            summary = sweep.measure()
            measured = time.perf_counter()
        stopped = time.perf_counter()
        file.close()
    if summary.missing or any(record.busy_s for record in summary.nodes):
        raise SystemExit(f"the sweep did not go well: {summary.reasons}, {summary.nodes}")
    command_s = sum(record.measured_s for record in summary.nodes)
    return SweepTimes(
        start_s=started - begin,
        command_s=command_s,
        other_s=measured - started - command_s,
        stop_s=stopped - measured,
    )


def print_cost(hand_s: Sequence[float], sweeps: Sequence[SweepTimes]) -> None:
    """Print what a sweep costs, and what its parts are."""
    mean_s = statistics.fmean(hand_s)
    overhead = sum(times.total_s for times in sweeps) / sum(hand_s) - 1
    print(f"by hand: {mean_s:.1f} s; by a sweep: {100 * overhead:+.1f} %, of which")
    for field in fields(SweepTimes):
        part_s = statistics.fmean(getattr(times, field.name) for times in sweeps)
        print(f"  {field.name:<12} {part_s:7.2f} s")


def main() -> None:
    """Measure and print."""
    from mjbench.sweep import matrix, software

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two models and two releases")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--time-limit", type=float, help="seconds of each verdict")
    chosen = parser.parse_args()
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    plan = plan_of(
        QUICK_MODELS if chosen.quick else models.shipped(),
        QUICK_RELEASES if chosen.quick else RELEASES,
        chosen.time_limit or (QUICK_TIME_LIMIT_S if chosen.quick else TIME_LIMIT_S),
    )
    of = matrix.build(plan, software.installed())
    hand_s, sweeps = [], []
    for number in range(max(1, chosen.rounds)):
        if number % 2:
            sweeps.append(by_sweep(of))
            hand_s.append(by_hand(of))
        else:
            hand_s.append(by_hand(of))
            sweeps.append(by_sweep(of))
    print_cost(hand_s, sweeps)


if __name__ == "__main__":
    main()
