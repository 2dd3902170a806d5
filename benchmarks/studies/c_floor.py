"""How close Python comes to a C program that loops `mj_step` on the same libmujoco.

    python -m benchmarks.studies.c_floor [MODEL …] [--budget SECONDS] [--launches N] [--write]

builds the program c_floor.c with the headers and the library of the installed MuJoCo, and runs it
beside each path on the same workload, both with and without a timer in the steps: Python with the
one that MuJoCo's Python package installs, C with its like. The C program is a process of its own,
which has no Python in it, and times its blocks itself. All four take turns on one core.

If final states are not the same to the last bit, an error takes the place of all figures.

Each launch has new processes: where data lie in memory alone changes a speed by a percent or more,
and stays the same for the life of a process.

`--write` stores the figures in results/c_floor.json and writes a part of docs/method/c.md from
them; `--page` writes that part alone.
"""

import argparse
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import mujoco
import numpy as np

from benchmarks.studies import c_floor_page, tally_command, tally_file
from benchmarks.studies.c_floor_tally import FloorRow, FloorTally, LaunchTimes
from mjbench import paths
from mjbench.errors import MachineError, one_line
from mjbench.host import isolate, machine
from mjbench.paired import cores
from mjbench.simulation import agreement, compat, models, workload
from mjbench.simulation.engine_clock import engine_clock
from mjbench.simulation.reference_run import step_s
from mjbench.status import ExitCode
from mjbench.verification.plan import choose_sizes

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results/c_floor.json"
# Steps for which python_loop_hold holds each control.
LONG_HOLD = 50
# A launch that is silent for longer is killed.
LIMIT_S = 120.0
# Rounds of blocks, at least and at most; both even.
LEAST_ROUNDS, MOST_ROUNDS = 8, 1000


@dataclass(frozen=True)
class FloorCase:
    """A path to compare with the C program."""

    label: str
    path: str
    options: Mapping[str, Any]
    hold: int = 1
    returns: workload.Product = workload.Product.FINAL


CASES = (
    FloorCase("mj_step(nstep=50)", "python_loop_hold", {}, hold=LONG_HOLD),
    FloorCase("rollout", "rollout", {"threads": 1}, returns=workload.Product.SENSORS),
    FloorCase("Batch.rollout", "batch_rollout", {"threads": 1, "data": "shared"}),
)


@dataclass(frozen=True)
class LaunchRequest:
    """What a launch measures."""

    program: Path
    source: models.ModelSource
    case: FloorCase
    budget_s: float


def build(folder: Path) -> Path:
    """Compile c_floor.c into `folder`; return the program."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise MachineError("no C compiler found: install gcc or clang")
    package = Path(mujoco.__file__).parent
    (library,) = (*package.glob("libmujoco.so*"), *package.glob("libmujoco*.dylib"))
    target = folder / "c_floor"
    command = [compiler, "-O2", f"-I{package / 'include'}", str(Path(__file__).with_suffix(".c"))]
    command += ["-o", str(target), str(library), f"-Wl,-rpath,{package}"]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    if completed.returncode:
        raise MachineError(f"{compiler} failed: {one_line(completed.stderr)}")
    return target


class CProgram:
    """The C program on a workload; leave it as a context manager, which ends it."""

    def __init__(self, program: Path, work: workload.Workload, folder: Path):
        """Start the program."""
        model_file, workload_file = folder / "model.mjb", folder / "workload.bin"
        mujoco.mj_saveModel(work.model, str(model_file), None)
        sizes = [work.nbatch, work.ncontrol, work.hold]
        sizes += [work.returns != workload.Product.FINAL, work.returns == workload.Product.SENSORS]
        arrays = [np.array(sizes, np.int64), work.initial_state, work.control]
        workload_file.write_bytes(b"".join(array.tobytes() for array in arrays))
        self._shape = work.initial_state.shape
        self._process = subprocess.Popen(
            [program, model_file, workload_file], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def __enter__(self) -> "CProgram":
        """Return it."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the program."""
        self._process.kill()
        self._process.communicate()

    def block_ns(self, has_timer: bool) -> int:
        """Run a block with or without a timer in its steps; return its nanoseconds."""
        stdout = self._ask(b"timer\n" if has_timer else b"plain\n")
        line = stdout.readline()
        if not line:
            raise MachineError(f"the C program ended with status {self._process.wait()}")
        return int(line)

    def final_states(self) -> np.ndarray:
        """Return the (nbatch, nstate) final states of the last block."""
        size = 8 * int(np.prod(self._shape))
        return np.frombuffer(self._ask(b"states\n").read(size)).reshape(self._shape)

    def _ask(self, command: bytes) -> Any:
        assert self._process.stdin and self._process.stdout, "both are pipes"
        try:
            self._process.stdin.write(command)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise MachineError(f"the C program ended with status {self._process.wait()}") from None
        return self._process.stdout


def launch(request: LaunchRequest) -> LaunchTimes:
    """Measure in new processes."""

    def refuse(ended: isolate.Ended) -> NoReturn:
        reason = f"{ended.status}: {ended.detail}"
        raise MachineError(f"{request.source.name}, {request.case.label}: {reason}")

    return isolate.call(measure_launch, request, limit_s=LIMIT_S, otherwise=refuse)


def measure_launch(request: LaunchRequest, channel: isolate.Channel) -> LaunchTimes:
    """Measure one launch; runs in a child process."""
    case = request.case
    model = models.load(request.source)
    sizes = choose_sizes(step_s(model), hold=case.hold)
    drawn = workload.make(model, sizes.nbatch, sizes.nstep, case.hold)
    work = drawn.returning(case.returns)
    prepared = paths.find(case.path).prepare(work, case.options, paths.Resources(work))

    def python_ns(has_timer: bool) -> int:
        prepared.clear()
        with engine_clock(has_timer):
            begin = time.perf_counter_ns()
            prepared.run()
            return time.perf_counter_ns() - begin

    with (
        tempfile.TemporaryDirectory() as folder,
        cores.pinned(cores.freest_core()),
        CProgram(request.program, work, Path(folder)) as program,
    ):
        blocks: dict[int, Callable[[], int]] = {
            0: lambda: program.block_ns(False),
            1: lambda: program.block_ns(True),
            2: lambda: python_ns(True),
            3: lambda: python_ns(False),
        }
        for i in blocks:
            blocks[i]()
        check(prepared.verified_states(), program.final_states(), model)
        measured = rounds(blocks, request.budget_s)
        check(prepared.final_states(), program.final_states(), model)
    medians = [statistics.median(ns[i] for ns in measured) / work.steps for i in blocks]
    ratios = [statistics.median(ns[i] / ns[0] for ns in measured) for i in (2, 3)]
    return LaunchTimes(*medians, *ratios)


def check(states: paths.States, c_states: np.ndarray, model: mujoco.MjModel) -> None:
    """Refuse a path whose final states are not those of the C program, to the last bit."""
    columns = compat.state_columns(model)
    difference = agreement.first_differing_entry(states.values, c_states, columns, states.mask)
    if difference:
        raise MachineError(f"the path disagrees with the C program: {difference}")


def rounds(
    blocks: Mapping[int, Callable[[], int]],
    budget_s: float,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Mapping[int, int]]:
    """Time blocks in turns; return the nanoseconds of each round, by the keys of the blocks.

    Each two rounds have one random order and its opposite, so that each block follows each other
    one as often. After the least number of rounds, no two begin that would exceed the budget.
    """
    rows: list[Mapping[int, int]] = []
    begin, longest_s = clock(), 0.0
    while len(rows) < MOST_ROUNDS:
        pair_begin = clock()
        if len(rows) >= LEAST_ROUNDS and pair_begin - begin + longest_s > budget_s:
            break
        order = random.sample(sorted(blocks), len(blocks))
        rows += [{key: blocks[key]() for key in turn} for turn in (order, order[::-1])]
        longest_s = max(longest_s, clock() - pair_begin)
    return rows


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Print a row per model and path; store them if asked to."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    parser.add_argument("--budget", type=float, default=0.5, help="seconds per launch")
    parser.add_argument("--launches", type=int, default=9, help="launches per path")
    parser.add_argument("--write", action="store_true", help=f"write {RESULTS.name} and the page")
    parser.add_argument("--page", action="store_true", help="write the page from what is stored")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        if not options.page:
            tally = FloorTally(machine.describe(), options.launches, _measure(options))
            if options.write:
                tally_file.write(RESULTS, tally)
        if options.page or options.write:
            c_floor_page.PART.write(c_floor_page.lines(stored()))
        return ExitCode.OK

    return tally_command.run("c_floor", action)


def stored() -> FloorTally:
    """Return the committed figures."""
    return tally_file.load(RESULTS, FloorTally, "how close Python comes to C")


def _measure(options: argparse.Namespace) -> list[FloorRow]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        program = build(Path(folder))
        print(c_floor_page.HEADING)
        for name in options.models or models.shipped():
            for case in CASES:
                request = LaunchRequest(program, models.resolve(name), case, options.budget)
                launches = [launch(request) for _ in range(options.launches)]
                rows.append(FloorRow.of(name, case.label, launches))
                print(c_floor_page.line(rows[-1]), flush=True)
    return rows


if __name__ == "__main__":
    # Not this module's own `main`: requests pickle by the name of their module, and no child
    # process could import `__main__`.
    from benchmarks.studies import c_floor

    sys.exit(c_floor.main())
