"""How close the paths in Python come to a C program that loops `mj_step` on the same libmujoco.

    python -m benchmarks.c_floor [MODEL …] [--budget SECONDS] [--launches N]

builds c_floor.c against the headers and the library of the installed MuJoCo. It times the C program
and each path in turns, in one process, on the same workload and, where the path allows it, in the
same MjData. The table has the path's time over the C program's, for each model and path: the median
over launches, and their range. At 1.000 nothing is lost.

Each launch is a process of its own: memory layout alone changes a speed by a percent or more, and
stays the same for the life of a process. If final states are not bit-identical, the program stops.

A C program returns what the path is asked for: final states, or, for `rollout+sensors`, the state
and the sensor data of every step, too.
"""

import argparse
import ctypes
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import paths
from mjbench.comparison.sizes import SizeRequest, choose_sizes
from mjbench.errors import MachineError, MjbenchError, one_line
from mjbench.instrument import isolate, stats, timing
from mjbench.simulation import agreement, compat, models, workload
from mjbench.simulation.work import step_s

# Steps for which python_loop_hold holds each control.
LONG_HOLD = 50
# Timed rounds of a launch, whatever the budget; a launch that is silent for longer is killed.
MIN_ROUNDS, MAX_ROUNDS = 4, 100_000
LIMIT_S = 120.0


@dataclass(frozen=True)
class FloorCase:
    """A path to compare with the C program.

    Attributes:
      label: its name in the table.
      path: name of the path.
      options: of the path.
      hold: steps per control.
      returns: what the path and the C program return.
    """

    label: str
    path: str
    options: Mapping[str, Any]
    hold: int = 1
    returns: workload.Product = workload.Product.FINAL


CASES = (
    FloorCase("rollout", "rollout", {"threads": 1}),
    FloorCase("rollout+sensors", "rollout", {"threads": 1}, returns=workload.Product.SENSORS),
    FloorCase("batch_rollout", "batch_rollout", {"threads": 1, "data": "shared"}),
    FloorCase("python_loop_hold", "python_loop_hold", {}, hold=LONG_HOLD),
)


@dataclass(frozen=True)
class LaunchRequest:
    """What a launch measures.

    Attributes:
      library: the compiled C program.
      source: the model.
      case: the path.
      budget_s: seconds of timing.
    """

    library: Path
    source: models.ModelSource
    case: FloorCase
    budget_s: float


@dataclass(frozen=True)
class LaunchResult:
    """What a launch measured.

    Attributes:
      step_ns: nanoseconds per step of the path, the median over rounds.
      time_ratio: the path's time over the C program's, the median over rounds.
    """

    step_ns: float
    time_ratio: float


def build(folder: Path) -> Path:
    """Compile c_floor.c into `folder`; return the shared library.

    Raises:
      MachineError: there is no compiler, or it fails.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise MachineError("no C compiler found: install gcc or clang")
    package = Path(mujoco.__file__).parent
    (library,) = (*package.glob("libmujoco.so*"), *package.glob("libmujoco*.dylib"))
    target = folder / "c_floor.so"
    command = [compiler, "-O2", "-shared", "-fPIC", f"-I{package / 'include'}"]
    command += [str(Path(__file__).with_suffix(".c")), "-o", str(target)]
    command += [str(library), f"-Wl,-rpath,{package}"]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    if completed.returncode:
        raise MachineError(f"{compiler} failed: {one_line(completed.stderr)}")
    return target


def c_loop(
    library: Path, work: workload.Workload, data: mujoco.MjData
) -> tuple[Callable[[], None], np.ndarray]:
    """Return the C program, ready to run a workload, and the array that it writes.

    Args:
      library: that `build` compiled.
      work: the workload, which says what is returned.
      data: to step in.

    Returns:
      The function that runs it, and its (nbatch, nstate) final states.
    """
    model = work.model
    final_state = np.empty_like(work.initial_state)
    arrays = [work.initial_state, np.ascontiguousarray(work.step_control), final_state]
    arrays += workload.StepOutputs.empty(work).arrays
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]
    pointers += [None] * (5 - len(pointers))
    addresses = ctypes.c_void_p(model._address), ctypes.c_void_p(data._address)
    function = ctypes.CDLL(str(library)).c_floor

    # C holds bare addresses: the default argument keeps alive what they point to.
    def run(owners: Any = (arrays, data)) -> None:
        function(*addresses, work.nbatch, work.nstep, *pointers)

    return run, final_state


def launch(request: LaunchRequest) -> LaunchResult:
    """Measure in a process of its own.

    Raises:
      MachineError: it failed, or the path disagrees with the C program.
    """
    results: list[LaunchResult] = []
    ended = isolate.run("benchmarks.c_floor:measure_launch", request, results.append, LIMIT_S)
    if not results:
        reason = f"{ended.status}: {ended.detail}"
        raise MachineError(f"{request.source.name}, {request.case.label}: {reason}")
    return results[0]


def measure_launch(request: LaunchRequest, channel: isolate.Channel) -> None:
    """Measure one launch and send its LaunchResult; runs in a child process."""
    case = request.case
    model = models.load(request.source)
    sizes = choose_sizes(step_s(model), SizeRequest(hold=case.hold))
    drawn = workload.make(model, sizes.nbatch, sizes.nstep, case.hold)
    work = drawn.returning(case.returns)
    resources = paths.Resources(work)
    (data,) = resources.datas(1)
    run_c, reference = c_loop(request.library, work, data)
    prepared = paths.find(case.path).prepare(work, case.options, resources)
    run_c()
    _compare(prepared.verified_states(), reference, model)
    contenders = [
        timing.Contender(run_c),
        timing.Contender(prepared.run, before=prepared.clear),
    ]
    rounds = timing.rounds(contenders, request.budget_s, MIN_ROUNDS, MAX_ROUNDS)
    c_s, path_s = np.array(list(rounds)).T
    time_ratio = stats.speedup(list(path_s), list(c_s)).median
    channel.send(LaunchResult(float(1e9 * np.median(path_s) / work.steps), time_ratio))


def _compare(states: paths.States, reference: np.ndarray, model: mujoco.MjModel) -> None:
    columns = compat.state_columns(model, compat.state_spec("INTEGRATION"))
    difference = agreement.first_differing_entry(states.values, reference, columns, states.mask)
    if difference:
        raise MachineError(f"the path disagrees with the C program: {difference}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, one row per model and path."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    parser.add_argument("--budget", type=float, default=0.5, help="seconds per launch")
    parser.add_argument("--launches", type=int, default=9, help="launches per path")
    options = parser.parse_args(arguments)
    try:
        with tempfile.TemporaryDirectory() as folder:
            library = build(Path(folder))
            print(f"{'model':18} {'path':17} {'ns/step':>10} {'over C':>8}  range of launches")
            for name in options.models or models.shipped():
                for case in CASES:
                    request = LaunchRequest(library, models.resolve(name), case, options.budget)
                    results = [launch(request) for _ in range(options.launches)]
                    print(_row(name, case, results), flush=True)
    except MjbenchError as error:
        sys.exit(f"c_floor: {error}")


def _row(name: str, case: FloorCase, results: Sequence[LaunchResult]) -> str:
    step_ns = statistics.median(result.step_ns for result in results)
    ratios = [result.time_ratio for result in results]
    return (
        f"{name:18} {case.label:17} {step_ns:10,.0f} {statistics.median(ratios):8.4f}"
        f"  {min(ratios):.4f}–{max(ratios):.4f}"
    )


if __name__ == "__main__":
    # Not this module's own `main`: requests pickle by the name of their module, and no child
    # process could import `__main__`.
    from benchmarks import c_floor

    c_floor.main()
