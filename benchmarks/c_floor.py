"""How close Python's paths come to a C program that loops mj_step on the same libmujoco.

    python -m benchmarks.c_floor [MODEL …] [--budget SECONDS] [--launches N]

builds c_floor.c against the headers and the library of the installed MuJoCo, and times it in
turns with the paths, in one process, on the same workload and, where the path lets it, in the same
MjData. It prints, for each model and path, the path's time over the C program's (1.000: nothing
lost): the median over launches, and their range. A launch is a process of its own, because memory
layout alone moves a speed by a percent or more and stays as it is while a process lives. Final
states must be bit-identical, or the program stops.

`rollout` is told to return nothing, like the loop; `rollout+states` returns the state and the
sensors after every step, and is compared with a C program that does so too.
"""

import argparse
import ctypes
import dataclasses
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import paths
from mjbench.comparison import measure
from mjbench.errors import MachineError, MjbenchError, one_line
from mjbench.instrument import isolate, stats, timing
from mjbench.simulation import agreement, compat, models, workload

# Steps that each control of python_loop_hold is held.
LONG_HOLD = 50


@dataclass(frozen=True)
class Contest:
    """A path against the C program.

    Attributes:
      label: what it is called in the table.
      path: name of the path.
      options: its options.
      hold: steps per control.
      returns_states: whether the C program returns every step's state too.
    """

    label: str
    path: str
    options: dict[str, Any]
    hold: int = 1
    returns_states: bool = False


CONTESTS = (
    Contest("rollout", "rollout", {"threads": 1, "returns": "nothing"}),
    Contest("rollout+states", "rollout", {"threads": 1}, returns_states=True),
    Contest("batch_rollout", "batch_rollout", {"threads": 1, "data": "shared"}),
    Contest("python_loop_hold", "python_loop_hold", {}, hold=LONG_HOLD),
)


def build(folder: Path) -> Path:
    """Compile c_floor.c into `folder`; return the shared library.

    Raises:
      MachineError: no compiler, or it fails.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise MachineError("no C compiler here: install gcc or clang")
    package = Path(mujoco.__file__).parent
    (library,) = package.glob("libmujoco.so*")
    target = folder / "c_floor.so"
    command = [compiler, "-O2", "-shared", "-fPIC", f"-I{package / 'include'}"]
    command += [str(Path(__file__).with_suffix(".c")), "-o", str(target)]
    command += [str(library), f"-Wl,-rpath,{package}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise MachineError(f"{compiler} failed: {one_line(done.stderr)}")
    return target


def c_loop(
    library: Path, work: workload.Workload, data: Any, returns_states: bool = False
) -> tuple[Callable[[], None], np.ndarray]:
    """Return the C program's run of a workload in `data`, and the array of its final states."""
    model = work.model
    final_state = np.empty_like(work.initial_state)
    arrays = [work.initial_state, np.ascontiguousarray(work.step_control), final_state]
    if returns_states:
        physics = compat.state_size(model, compat.state_spec("FULLPHYSICS"))
        arrays += [np.empty((work.steps, n)) for n in (physics, model.nsensordata)]
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]
    pointers += [None] * (5 - len(pointers))
    addresses = ctypes.c_void_p(model._address), ctypes.c_void_p(data._address)

    function = ctypes.CDLL(str(library)).c_floor

    def run(keep: Any = (arrays, data)) -> None:
        function(*addresses, work.nbatch, work.nstep, *pointers)

    return run, final_state


def launch(library: Path, name: str, contest: Contest, budget_s: float) -> tuple[float, float]:
    """Return one launch's ns per step of the path, and its time over the C program's.

    Raises:
      MachineError: the launch failed, or the two disagree.
    """
    request = {
        "library": str(library),
        "path": str(models.resolve(name).path),
        "contest": dataclasses.asdict(contest),
        "budget_s": budget_s,
    }
    found: list[dict[str, float]] = []
    ended = isolate.run("benchmarks.c_floor:measure_launch", request, found.append, 120.0)
    if ended.status != "ok":
        raise MachineError(f"{name}, {contest.label}: {ended.status}: {ended.detail}")
    return found[0]["step_ns"], found[0]["ratio"]


def measure_launch(request: dict[str, Any], channel: isolate.Channel) -> None:
    """Measure one launch and send it; runs in a child process."""
    contest = Contest(**request["contest"])
    model = models.load(models.ModelSource(contest.label, Path(request["path"])))
    sizes = {"nbatch": None, "nstep": None, "hold": contest.hold, "largest": 1}
    nbatch, nstep, _ = measure.sizes(model, sizes)
    work = workload.make(model, nbatch, nstep, contest.hold)
    resources = paths.Resources(work)
    library = Path(request["library"])
    run, reference = c_loop(library, work, resources.datas(1)[0], contest.returns_states)
    run()
    prepared = paths.find(contest.path).prepare(work, contest.options, resources)
    states = prepared.verified_states()
    columns = compat.state_columns(model, compat.state_spec("INTEGRATION"))
    difference = agreement.first_difference(states.values, reference, columns, states.mask)
    if difference:
        raise MachineError(f"disagrees with the C program: {difference}")
    contenders = [
        timing.Contender(_nothing, run, _nothing),
        timing.Contender(prepared.clear, prepared.run, _nothing),
    ]
    rounds = np.array(list(timing.rounds(contenders, request["budget_s"], 4, 100_000)))
    ratio = stats.speedup(list(rounds[:, 1]), list(rounds[:, 0])).median
    channel.send(step_ns=float(1e9 * np.median(rounds[:, 1]) / work.steps), ratio=ratio)


def _nothing() -> None:
    pass


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    parser.add_argument("--budget", type=float, default=0.5, help="seconds per launch")
    parser.add_argument("--launches", type=int, default=9, help="launches per path")
    given = parser.parse_args(words)
    try:
        with tempfile.TemporaryDirectory() as folder:
            library = build(Path(folder))
            print(f"{'model':18} {'path':17} {'ns/step':>10} {'over C':>8}  range of launches")
            for name in given.models or models.shipped():
                for contest in CONTESTS:
                    found = [
                        launch(library, name, contest, given.budget) for _ in range(given.launches)
                    ]
                    step_ns, ratios = zip(*found, strict=True)
                    print(
                        f"{name:18} {contest.label:17} {statistics.median(step_ns):10,.0f}"
                        f" {statistics.median(ratios):8.4f}  {min(ratios):.4f}–{max(ratios):.4f}",
                        flush=True,
                    )
    except MjbenchError as error:
        sys.exit(f"c_floor: {error}")


if __name__ == "__main__":
    main()
