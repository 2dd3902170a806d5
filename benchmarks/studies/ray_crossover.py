"""From how much work per call on the path `ray` overtakes others, on models of three step costs.

    python -m benchmarks.studies.ray_crossover [MODEL …] [--budget SECONDS] [--page]

compares `ray` with the plain loop, `rollout` on one and on all threads, and `processes`, from calls
of a few steps to calls of half a second. It also measures what Ray takes while nobody uses it. It
writes results/ray.json, and a part of docs/guides/machines.md from it. Named models replace their
rows; `--page` only writes that part again. It takes about five minutes, and needs the machine for
itself.
"""

import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

import mjbench
from benchmarks.studies import ray_page, tally_command, tally_file
from benchmarks.studies.ray_tally import (
    CallWork,
    Case,
    Overtaking,
    PathTime,
    RayCost,
    RayModel,
    RaySize,
    RayTally,
    load,
)
from mjbench import extras, paths
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.paths import local_ray
from mjbench.paths.base import nthread
from mjbench.simulation import models, workload
from mjbench.status import ExitCode

if TYPE_CHECKING:
    import psutil

    from mjbench.report.path_speedups import PathResult

ROOT = Path(__file__).resolve().parents[2]
TALLY = ROOT / "results" / "ray.json"
# About 3, 20 and 500 µs a step. The fewer steps a simulation has, the less the least work is.
CASES = (Case("cartpole", nstep=20), Case("cube_table", nstep=10), Case("cloth", nstep=2))
# Simulations: each number is four times the one before, until the plain loop takes this long.
FIRST_NBATCH, FACTOR, MOST_LOOP_S = 2, 4, 0.6
# Seconds of timing at each size.
BUDGET_S = 4.0
# Seconds for which Ray idles while its processor time is measured.
IDLE_S = 20.0


def measured(case: Case, budget_s: float) -> RayModel:
    """Compare the paths on one model, from the least work on."""
    from mjbench.report.crossovers import RAY, RIVALS, work_crossovers

    results: list[PathResult] = []
    sizes: list[RaySize] = []
    nbatch = FIRST_NBATCH
    while not sizes or FACTOR * sizes[-1].loop_ms <= 1e3 * MOST_LOOP_S:
        compared = mjbench.compare(
            case.model,
            paths=[*RIVALS, RAY],
            nbatch=nbatch,
            nstep=case.nstep,
            budget_s=budget_s,
        ).results
        results += compared
        sizes.append(RaySize(nbatch, case.nstep, _times(compared)))
        print(ray_page.size_line(sizes[-1]), flush=True)
        nbatch *= FACTOR
    crossovers = [
        Overtaking(
            row.rival.path,
            nthread(row.rival.options),
            CallWork(row.least.steps, row.least.loop_ms) if row.least else None,
            CallWork(row.largest.steps, row.largest.loop_ms),
            row.share,
        )
        for row in work_crossovers(results)
    ]
    step_us = 1e3 * sizes[-1].loop_ms / sizes[-1].steps
    return RayModel(case.model, step_us, case.nstep, sizes, crossovers)


def _times(results: "Sequence[PathResult]") -> list[PathTime]:
    """Return the milliseconds of a call of each path with each number of threads."""
    fastest: dict[tuple[str, int], float] = {}
    for result in results:
        if result.step_ns is None or result.nbatch is None or result.nstep is None:
            raise InputError(f"{result.model}: {result.path}: {result.status}: {result.detail}")
        key = result.path, nthread(result.options)
        ms = 1e-6 * result.step_ns * result.nbatch * result.nstep
        fastest[key] = min(ms, fastest.get(key, ms))
    return [PathTime(path, count, ms) for (path, count), ms in fastest.items()]


def cost() -> RayCost:
    """Measure what Ray takes while nobody uses it, and what its actors take."""
    import psutil

    own = psutil.Process()
    begin = time.perf_counter()
    local_ray.acquire(0)
    start_s = time.perf_counter() - begin
    try:
        services = own.children(recursive=True)
        services_bytes = _memory_bytes(services)
        before_s = _processor_s(services)
        time.sleep(IDLE_S)
        idle_share = (_processor_s(services) - before_s) / IDLE_S
        small = workload.make(models.load(models.resolve("cartpole")), nbatch=2, nstep=1)
        resources = paths.Resources(small)
        begin = time.perf_counter()
        paths.find("ray").prepare(small, {"actors": 2}, resources).run()
        actors_s = time.perf_counter() - begin
        actors = [each for each in own.children(recursive=True) if each not in services]
        actor_bytes = _memory_bytes(actors) // len(actors)
        resources.close()
    finally:
        local_ray.release()
    return RayCost(start_s, actors_s, idle_share, services_bytes, actor_bytes)


def _memory_bytes(processes: "Sequence[psutil.Process]") -> int:
    """Return the memory that processes do not share with others."""
    return sum(process.memory_full_info().uss for process in processes)


def _processor_s(processes: "Sequence[psutil.Process]") -> float:
    times = [process.cpu_times() for process in processes]
    return sum(each.user + each.system for each in times)


def run(names: Sequence[str], budget_s: float) -> RayTally:
    """Measure models, and write the tally and the page after each.

    Args:
      budget_s: seconds of timing at each size.
    """
    extras.require("this benchmark", "ray", ["ray"])
    cases = [case for case in CASES if not names or case.model in names]
    if not cases:
        raise InputError(f"no model is named {', '.join(names)}")
    done = {model.model: model for model in (load(TALLY).models if names else ())}
    ray_cost = cost()
    for case in cases:
        print(f"{case.model}, {case.nstep} steps per simulation", flush=True)
        done[case.model] = measured(case, budget_s)
        tally = RayTally(
            date=datetime.now(UTC).date().isoformat(),
            processor=machine.describe().cpu,
            usable_cores=machine.usable_cores(),
            mujoco=mujoco.__version__,
            ray=version("ray"),
            cost=ray_cost,
            models=list(done.values()),
        )
        save(tally)
    return tally


def save(tally: RayTally) -> None:
    """Write the tally and the page."""
    tally_file.write(TALLY, tally)
    ray_page.PART.write(ray_page.lines(tally))


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--budget", type=float, default=BUDGET_S, help="seconds at each size")
    parser.add_argument("--page", action="store_true", help="only write the page again")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        if options.page:
            save(load(TALLY))
        else:
            run(options.models, options.budget)
        return ExitCode.OK

    return tally_command.run("ray_crossover", action, "the tally has what was measured")


if __name__ == "__main__":
    sys.exit(main())
