"""How much does `mjbench run` slow a program, and do its samples cover the program's time?

    python -m benchmarks.observing [PROGRAM …] [--seconds S] [--rounds N] [--rate HZ]

runs programs alone and under `mjbench run`, in turns. A program is a model's name, for a loop
around `mj_step` with a small observation; or `processes`, for a loop that waits for four processes,
each of which steps the humanoid 20 times. Each of the four has a fixed core: where Linux chooses,
such a loop takes much longer in one run than in another. A program says how many
steps it did in so many seconds. The table has, for each program, what observing costs with its 95 %
interval, what `mjbench run` itself says that it costs, and the time of the samples of the main loop
as a share of the loop's own.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.instrument import stats
from mjbench.simulation import models

# The engine's step takes about 2, 20 and 300 µs in the models.
PROCESSES = "processes"
PROGRAMS = ("cartpole", "humanoid", "pile", PROCESSES)
OF_MODEL = """
import sys, time
import mujoco, numpy as np

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
begin, nstep = time.perf_counter(), 0
while (elapsed := time.perf_counter() - begin) < float(sys.argv[2]):
    for _ in range(100):
        mujoco.mj_step(model, data)
        observation = np.concatenate([data.qpos, data.qvel])
    nstep += 100
    if nstep % 10_000 == 0:
        mujoco.mj_resetData(model, data)
print(elapsed, nstep)
"""
OF_PROCESSES = """
import multiprocessing, os, sys, time
import mujoco

def work(path, pipe, core):
    os.sched_setaffinity(0, [core])
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    while (nstep := pipe.recv()):
        for _ in range(nstep):
            mujoco.mj_step(model, data)
        if data.time > 20:
            mujoco.mj_resetData(model, data)
        pipe.send(data.qpos.copy())

if __name__ == "__main__":
    pairs = [multiprocessing.Pipe() for _ in range(4)]
    pipes = [here for here, _ in pairs]
    cores = sorted(os.sched_getaffinity(0)) * 4
    processes = [
        multiprocessing.Process(target=work, args=(sys.argv[1], there, core))
        for (_, there), core in zip(pairs, cores)
    ]
    for process in processes:
        process.start()
    begin, nstep = time.perf_counter(), 0
    while (elapsed := time.perf_counter() - begin) < float(sys.argv[2]):
        for _ in range(10):
            for pipe in pipes:
                pipe.send(20)
            states = [pipe.recv() for pipe in pipes]
        nstep += 10 * 20 * len(pipes)
    for pipe in pipes:
        pipe.send(0)
    print(elapsed, nstep)
"""


@dataclass(frozen=True)
class Observed:
    """One run of the loop under `mjbench run`.

    Attributes:
      step_s: seconds of a step.
      cost_share: what the run says that observing costs.
      coverage: time of the samples of the loop over its own time.
    """

    step_s: float
    cost_share: float
    coverage: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure each program, and print the table; return 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", nargs="*", default=PROGRAMS)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--rate", help="samples per second; by default as mjbench run chooses")
    options = parser.parse_args(arguments)
    rate = ["--rate", options.rate] if options.rate else []
    print(f"{'program':18} {'costs':>7} {'interval':>18} {'it says':>8} {'samples / time':>15}")
    for name in options.programs:
        print(_line(name, options.seconds, options.rounds, rate), flush=True)
    return 0


def _line(name: str, seconds: float, rounds: int, rate: Sequence[str]) -> str:
    """Return the line of a program."""
    path = models.resolve("humanoid" if name == PROCESSES else name).path
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "loop.py"
        program.write_text(OF_PROCESSES if name == PROCESSES else OF_MODEL)
        program_command = [str(program), str(path), str(seconds)]
        alone, observed = [], []
        for number in range(rounds):
            for is_alone in (True, False) if number % 2 == 0 else (False, True):
                if is_alone:
                    alone.append(_alone(program_command))
                else:
                    observed.append(_observed(program_command, Path(folder), rate))
    slowdown = stats.speedup([each.step_s for each in observed], alone)
    ends = [100 * (end - 1) for end in (slowdown.low, slowdown.high) if end is not None]
    interval = " to ".join(f"{end:+.1f}" for end in ends) or "too few rounds"
    says = statistics.median(each.cost_share for each in observed)
    coverage = [each.coverage for each in observed]
    return (
        f"{name:18} {100 * (slowdown.median - 1):+5.1f} % {interval:>16} % {100 * says:6.1f} %"
        f" {min(coverage):6.3f}–{max(coverage):.3f}"
    )


def _alone(program_command: Sequence[str]) -> float:
    """Return the seconds of a step of the loop alone."""
    done = subprocess.run(
        [sys.executable, *program_command], capture_output=True, text=True, check=True
    )
    elapsed_s, nstep = map(float, done.stdout.split())
    return elapsed_s / nstep


def _observed(program_command: Sequence[str], folder: Path, rate: Sequence[str]) -> Observed:
    """Run the loop under `mjbench run`."""
    import msgspec

    from mjbench.program.records import ProgramRow

    document = folder / "run.json"
    command = [sys.executable, "-m", "mjbench", "run", "--json", str(document), *rate]
    command += ["--results", str(folder), *program_command]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    elapsed_s, nstep = map(float, done.stdout.split())
    (row,) = json.loads(document.read_text())["results"]
    program = msgspec.convert(row, ProgramRow)
    sampled_s = sum(loop.time.seconds for loop in program.loops if loop.time.in_main)
    return Observed(elapsed_s / nstep, program.cost_share, sampled_s / elapsed_s)


if __name__ == "__main__":
    sys.exit(main())
