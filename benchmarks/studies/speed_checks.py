"""How far identical functions seem to differ: what the pytest fixture `mjbench` has to allow for.

    python -m benchmarks.studies.speed_checks [PROCESSES]

Each process draws a load of the machine (none, or busy processes), builds some functions twice, and
measures the two against each other, as `mjbench.not_slower(new, baseline=old)` does. The ratio
should be one in every process. The tables say how far it is not, how often the fixture would have
been wrong, and how much the time of one function differs from process to process.
"""

import json
import math
import random
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from mjbench.simulation import models, workload
from mjbench.testing.callables import Answer

PROCESSES = 30
Function = Callable[[], object]
TIME_LIMIT_S, CONFIDENCE = 5.0, 0.99
# Programs that keep the machine busy meanwhile, and how many of each; half of the draws are quiet.
_SPIN, _COPY = "while True: pass", "x = bytes(1 << 26)\nwhile True: bytearray(x)"
LOADS: Sequence[tuple[str, str, int]] = (
    *(("quiet", "", 0),) * 4,
    ("one spins", _SPIN, 1),
    ("two spin", _SPIN, 2),
    ("one copies", _COPY, 1),
    ("two copy", _COPY, 2),
)


@dataclass(frozen=True)
class Measured:
    """What one process measured of one function.

    Attributes:
      candidate_s: seconds of a call.
    """

    function: str
    load: str
    answer: Answer
    log_ratio: float
    candidate_s: float


def _steps(name: str, nstep: int) -> Function:
    """Return a function that steps a model from its start, in a Python loop."""
    model = models.load(models.resolve(name))
    data = workload.start_data(model)

    def run() -> None:
        workload.reset_to_start(model, data)
        for _ in range(nstep):
            mujoco.mj_step(model, data)

    return run


def _observations() -> Function:
    data = workload.start_data(models.load(models.resolve("humanoid")))
    return lambda: np.concatenate([data.qpos[2:], data.qvel, data.xpos[1]])


def _sum_of_copy(nbyte: int) -> Function:
    array = np.ones(nbyte // 8)
    return lambda: array.copy().sum()


FUNCTIONS: dict[str, Callable[[], Function]] = {
    "20 steps of the cart-pole": lambda: _steps("cartpole", 20),
    "10 steps of the humanoid": lambda: _steps("humanoid", 10),
    "an observation by NumPy": _observations,
    "the sum of a copy of 256 KiB": lambda: _sum_of_copy(1 << 18),
    "the sum of a copy of 8 MiB": lambda: _sum_of_copy(1 << 23),
}


def measure(load: str) -> list[Measured]:
    """Measure each function and its twin in this process."""
    from mjbench.testing import callables
    from mjbench.testing.callables import FunctionPair, SpeedQuestion
    from mjbench.testing.fixture import MAX_SLOWDOWN

    question = SpeedQuestion(MAX_SLOWDOWN, CONFIDENCE, TIME_LIMIT_S)
    measured = []
    for name, make in FUNCTIONS.items():
        first, second = make(), make()
        check = callables.compare(FunctionPair(first, second), question)
        assert check.ratio is not None
        assert check.candidate_s is not None
        log_ratio = math.log(check.ratio)
        measured.append(Measured(name, load, check.answer, log_ratio, check.candidate_s))
    return measured


def in_processes(count: int) -> list[Measured]:
    """Return what some processes measured, one after the other, each under a load of its own."""
    measured = []
    for number in range(count):
        load, program, busy = random.choice(LOADS)
        others = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(busy)]
        try:
            done = subprocess.run(
                [sys.executable, "-m", "benchmarks.studies.speed_checks", "--measure", load],
                capture_output=True,
                text=True,
                check=True,
            )
        finally:
            for other in others:
                other.kill()
                other.wait()
        measured += [
            Measured(**{**row, "answer": Answer(row["answer"])}) for row in json.loads(done.stdout)
        ]
        print(f"\r{number + 1} of {count}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return measured


def table(measured: Sequence[Measured]) -> list[str]:
    """Return how far two identical functions of one process differ, as Markdown."""
    lines = [
        "| function | processes | sd of the ratio | largest | not slower | inconclusive | slower"
        " | sd of its time |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name in FUNCTIONS:
        rows = [row for row in measured if row.function == name]
        logs = [row.log_ratio for row in rows]
        answers = [sum(row.answer == answer for row in rows) for answer in _ANSWERS]
        cells = f"{_percent(float(np.std(logs)))} | {_percent(max(map(abs, logs)))}"
        spread = _percent(float(np.std([np.log(row.candidate_s) for row in rows])))
        counts = " | ".join(map(str, answers))
        lines.append(f"| {name} | {len(rows)} | {cells} | {counts} | {spread} |")
    return lines


_ANSWERS = (Answer.NOT_SLOWER, Answer.INCONCLUSIVE, Answer.SLOWER)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def main() -> None:
    """Measure, and print tables; with `--measure LOAD`, be one of the processes."""
    if sys.argv[1:2] == ["--measure"]:
        print(json.dumps([asdict(row) for row in measure(sys.argv[2])]))
        return
    measured = in_processes(int(sys.argv[1]) if len(sys.argv) > 1 else PROCESSES)
    quiet = [each for each in measured if each.load == "quiet"]
    for title, rows in (("quiet", quiet), ("all", measured)):
        if not rows:
            continue
        print(f"\nLoad: {title}\n")
        print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
