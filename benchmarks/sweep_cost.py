"""What does `mjbench sweep` cost beside the commands that it runs?

    python -m benchmarks.sweep_cost [--quick] [--rounds N] [--time-limit S] [--write]

measures the ten shipped models in four releases twice in each round: by hand, one command of
mjbench after the other, and by a sweep on one node of Ray that is started for it. The order changes
from round to round. Every verdict takes all of its time limit, so that both do equally much. The
overhead is by how much longer the sweep takes; beside it stand its parts.

Then it has one and two nodes of Ray, both on this machine, run commands that do nothing: how long a
task takes beside its command, and how much processor time the sweep needs for it. Last, it times
the choice of what to measure next, for a large matrix. `--write` stores all of it in
results/sweep.json.
"""

import argparse
import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies import tally_file
from benchmarks.studies.sweep_tally import ChoiceCost, SweepCost, SweepTimes, TaskCost
from mjbench.simulation import models

if TYPE_CHECKING:
    from mjbench.sweep.commands import CommandLine
    from mjbench.sweep.matrix import Matrix
    from mjbench.sweep.plan import Plan
    from mjbench.sweep.ray_cluster import RayCluster
    from mjbench.sweep.scheduler import Node

RELEASES = ("3.3.0", "3.9.0", "3.17.0", "4.0.0")
QUICK_MODELS, QUICK_RELEASES = ("cartpole", "cube_table"), ("3.17.0", "4.0.0")
TIME_LIMIT_S, QUICK_TIME_LIMIT_S = 15.0, 3.0
# Commands that do nothing, for each number of nodes.
TASKS, QUICK_TASKS = 100, 10
# The matrix of which the choice of the next cells is timed, and the nodes that ask for them.
LARGE_MODELS, LARGE_RELEASES, LARGE_NODES = 331, 42, 100
RESULT = Path("results/sweep.json")


def plan_of(model_names: Sequence[str], versions: Sequence[str], time_limit_s: float) -> "Plan":
    """Return a plan whose verdicts all take their time limit, on nodes that never refuse."""
    from mjbench.paired.outcomes import Metric
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.sweep.calibration import Limits
    from mjbench.sweep.cells import Kind
    from mjbench.sweep.plan import NodeRules, Part, Plan

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
        parts=(Part(Kind.VERSIONS, options),),
        rules=NodeRules(limits=anything),
    )


def command_lines(of: "Matrix") -> list["CommandLine"]:
    """Return the command lines that a sweep on one node runs, in its order."""
    from mjbench.sweep.scheduler import Node, Scheduler

    scheduler = Scheduler(of.cells)
    scheduler.join(Node("node", "node", "host"))
    lines = []
    while assignments := scheduler.assign(0.0):
        for assignment in assignments:
            lines.append(of.command_line(assignment.cells))
            for cell in assignment.cells:
                scheduler.deliver(assignment.number, cell)
            scheduler.end(assignment.number, "", 0.0)
    return lines


def by_hand(of: "Matrix") -> float:
    """Return the seconds of all commands, one after the other."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        for line in command_lines(of):
            arguments = [*line.arguments, "--results", folder, "--wait", "--", *line.operands]
            subprocess.run(
                [sys.executable, "-m", "mjbench", *arguments], check=True, stdout=subprocess.DEVNULL
            )
        return time.perf_counter() - begin


def by_sweep(plan: "Plan") -> SweepTimes:
    """Return the seconds of a sweep that does the same."""
    from mjbench.instrument.run_set import RunSetFile
    from mjbench.report.documents import RECORD_TYPES
    from mjbench.sweep import matrix, software
    from mjbench.sweep.ray_cluster import RayCluster
    from mjbench.sweep.results import CellResult
    from mjbench.sweep.run import Sweep

    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        of = matrix.build(plan, software.installed())
        file = RunSetFile.create(Path(folder) / "set.jsonl")

        def store(result: CellResult) -> None:
            file.append(result.section)

        planned = time.perf_counter()
        with RayCluster() as cluster:
            sweep = Sweep(of, (), cluster, store, RECORD_TYPES)
            sweep.take_nodes(cluster.ask_nodes())
            started = time.perf_counter()
            summary = sweep.measure()
            measured = time.perf_counter()
        stopped = time.perf_counter()
        file.close()
    if summary.missing or any(record.failed or record.refused for record in summary.nodes):
        raise SystemExit(f"the sweep did not go well: {summary.reasons}, {summary.nodes}")
    wall_s = sum(finished.wall_s for finished in summary.finished)
    command_s = sum(finished.command_s for finished in summary.finished)
    return SweepTimes(
        plan_s=planned - begin,
        start_s=started - planned,
        command_s=command_s,
        calibration_s=wall_s - command_s,
        scheduling_s=measured - started - wall_s,
        stop_s=stopped - measured,
        tasks=len(summary.finished),
    )


def task_cost(node_count: int, tasks: int) -> TaskCost:
    """Return what tasks cost whose command does nothing, on some nodes of Ray on this machine."""
    from ray.cluster_utils import Cluster

    from mjbench.instrument import ray_environment
    from mjbench.sweep.executor import Joined
    from mjbench.sweep.ray_cluster import RayCluster
    from mjbench.sweep.ray_session import RESOURCE

    # with the secret of a sweep that ran in this process before
    with ray_environment.local(), contextlib.ExitStack() as closing:
        ray_nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
        closing.callback(ray_nodes.shutdown)
        for _ in range(node_count):
            ray_nodes.add_node(num_cpus=1, resources={RESOURCE: 1})
        with RayCluster(ray_nodes.address) as cluster:
            joined = [event.node for event in cluster.ask_nodes() if isinstance(event, Joined)]
            nodes = [replace(node, cores=1) for node in joined]
            _run_tasks(cluster, nodes, node_count)  # workers start with their first task
            cpu_s, begin = time.process_time(), time.perf_counter()
            latencies = _run_tasks(cluster, nodes, tasks)
            wall_s, driver_s = time.perf_counter() - begin, time.process_time() - cpu_s
    return TaskCost(
        node_count, tasks, statistics.median(latencies), tasks / wall_s, driver_s / tasks
    )


def _run_tasks(cluster: "RayCluster", nodes: Sequence["Node"], count: int) -> list[float]:
    """Run tasks, one at a time on each node; return how long each took beside its command."""
    from mjbench.sweep.commands import CommandLine
    from mjbench.sweep.executor import Died, Reported
    from mjbench.sweep.messages import Finished, Request

    request = Request(CommandLine(("instructions",), ("nothing",)), program=("true",))
    began: dict[int, tuple[Node, float]] = {}
    latencies: list[float] = []
    idle, number = list(nodes), 0
    while len(latencies) < count:
        while idle and number < count:
            node = idle.pop()
            began[number] = node, time.perf_counter()
            cluster.start(number, node, request, [])
            number += 1
        for event in cluster.events(1.0):
            match event:
                case Reported(done, Finished() as finished):
                    node, begin = began.pop(done)
                    latencies.append(time.perf_counter() - begin - finished.command_s)
                    idle.append(node)
                case Died(_, reason):
                    raise SystemExit(f"a task died: {reason}")
    return latencies


def choice_cost(model_count: int, release_count: int, node_count: int) -> ChoiceCost:
    """Return what it costs to hand out a large matrix, whose cells are all done at once."""
    from mjbench.paired.outcomes import Metric
    from mjbench.sweep.cells import Cell, Kind
    from mjbench.sweep.scheduler import Node, Scheduler

    cells = [
        Cell(Kind.VERSIONS, f"model {m}", f"3.{r}.0", "3.0.0", "", "python_loop", Metric.TIME)
        for r in range(1, release_count)
        for m in range(model_count)
    ]
    scheduler = Scheduler(cells)
    for number in range(node_count):
        scheduler.join(Node(str(number), str(number), str(number)))
    count, seconds = 0, 0.0
    while True:
        begin = time.perf_counter()
        assignments = scheduler.assign(0.0)
        seconds += time.perf_counter() - begin
        if not assignments:
            break
        for assignment in assignments:
            count += 1
            for cell in assignment.cells:
                scheduler.deliver(assignment.number, cell)
            scheduler.end(assignment.number, "", 0.0)
    return ChoiceCost(len(cells), node_count, count, seconds / count)


def measure(
    model_names: Sequence[str],
    versions: Sequence[str],
    time_limit_s: float,
    rounds: int,
    tasks: int,
    is_large: bool,
) -> SweepCost:
    """Measure all of it."""
    from mjbench.instrument import machine
    from mjbench.sweep import matrix, software

    plan = plan_of(model_names, versions, time_limit_s)
    of = matrix.build(plan, software.installed())
    hand, sweeps = [], []
    for number in range(rounds):
        if number % 2:
            sweeps.append(by_sweep(plan))
            hand.append(by_hand(of))
        else:
            hand.append(by_hand(of))
            sweeps.append(by_sweep(plan))
    size = (LARGE_MODELS, LARGE_RELEASES, LARGE_NODES) if is_large else (20, 5, 10)
    return SweepCost(
        machine=machine.describe(),
        models=model_names,
        releases=versions,
        time_limit_s=time_limit_s,
        by_hand_s=hand,
        sweeps=sweeps,
        overhead=sum(times.total_s for times in sweeps) / sum(hand) - 1,
        tasks=[task_cost(count, tasks) for count in (1, 2)],
        choice=choice_cost(*size),
    )


def print_cost(cost: SweepCost) -> None:
    """Print what a sweep costs, and what its parts are."""
    hand_s = statistics.fmean(cost.by_hand_s)
    count = len(cost.models) * (len(cost.releases) - 1)
    print(f"{count} verdicts of {cost.time_limit_s:g} s by hand: {hand_s:.1f} s")
    print(f"by a sweep: {100 * cost.overhead:+.1f} %, of which")
    shares = (
        ("the plan", [times.plan_s for times in cost.sweeps]),
        ("starting Ray, and asking the node", [times.start_s for times in cost.sweeps]),
        ("calibrations", [times.calibration_s for times in cost.sweeps]),
        ("between tasks", [times.scheduling_s for times in cost.sweeps]),
        ("ending Ray", [times.stop_s for times in cost.sweeps]),
        (
            "the same commands, beside Ray",
            [t.command_s - h for t, h in zip(cost.sweeps, cost.by_hand_s, strict=True)],
        ),
    )
    for name, seconds in shares:
        mean_s = statistics.fmean(seconds)
        print(f"  {name:<36} {mean_s:+7.2f} s  {100 * mean_s / hand_s:+6.2f} %")
    print(f"  tasks: {cost.sweeps[0].tasks}")
    for task in cost.tasks:
        print(
            f"{task.nodes} nodes of Ray, {task.tasks} tasks that do nothing:"
            f" {1e3 * task.latency_s:.1f} ms beside the command, {task.tasks_per_s:.1f} tasks/s,"
            f" {1e3 * task.driver_s:.1f} ms of processor time here"
        )
    choice = cost.choice
    print(
        f"choosing among {choice.cells} cells for {choice.nodes} nodes:"
        f" {1e3 * choice.choice_s:.2f} ms for each of {choice.assignments} tasks"
    )


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two models and two releases")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--time-limit", type=float, help="seconds of each verdict")
    parser.add_argument("--write", action="store_true", help=f"store it in {RESULT}")
    chosen = parser.parse_args()
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    usual_s = QUICK_TIME_LIMIT_S if chosen.quick else TIME_LIMIT_S
    cost = measure(
        QUICK_MODELS if chosen.quick else models.shipped(),
        QUICK_RELEASES if chosen.quick else RELEASES,
        chosen.time_limit or usual_s,
        max(1, chosen.rounds),
        QUICK_TASKS if chosen.quick else TASKS,
        is_large=not chosen.quick,
    )
    print_cost(cost)
    if chosen.write:
        RESULT.write_text(tally_file.dumps(cost), encoding="utf-8")


if __name__ == "__main__":
    main()
