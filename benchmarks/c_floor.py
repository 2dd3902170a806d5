"""How close Python's paths come to a C program that loops mj_step on the same libmujoco.

    python -m benchmarks.c_floor [MODEL …] [--budget SECONDS] [--rounds N]

builds c_floor.c against the headers and the library of the installed MuJoCo, and times it in
turns with the paths, in one process, on the same workload. It prints, for each model and path,
the path's time over the C program's (1.000: nothing lost) with its 95 % interval. Final states
must be bit-identical, or the program stops.
"""

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import agreement, compat, measure, models, paths, stats, timing, workload
from mjbench.errors import MachineError, MjbenchError, one_line

# Steps that each control of python_loop_hold is held.
LONG_HOLD = 50
PATHS: tuple[tuple[str, dict[str, Any], int], ...] = (
    ("rollout", {"threads": 1}, 1),
    ("batch_rollout", {"threads": 1, "data": "shared"}, 1),
    ("python_loop_hold", {}, LONG_HOLD),
)


def build(folder: Path) -> ctypes.CDLL:
    """Compile c_floor.c into `folder` and load it.

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
    return ctypes.CDLL(str(target))


def c_loop(library: ctypes.CDLL, work: workload.Workload) -> tuple[Callable[[], None], np.ndarray]:
    """Return the C program's run of a workload, and the array of its final states."""
    data = mujoco.MjData(work.model)
    control = np.ascontiguousarray(work.step_control)
    final_state = np.empty_like(work.initial_state)
    arguments = (
        ctypes.c_void_p(work.model._address),
        ctypes.c_void_p(data._address),
        work.nbatch,
        work.nstep,
        *(a.ctypes.data_as(ctypes.c_void_p) for a in (work.initial_state, control, final_state)),
    )

    def run() -> None:
        library.c_floor(*arguments)

    run.keep = data, control  # type: ignore[attr-defined]
    return run, final_state


def ratios(
    library: ctypes.CDLL, name: str, budget_s: float, most: int
) -> list[tuple[str, float, stats.Estimate]]:
    """Return (path, ns per step, path's time over the C program's) of one model."""
    model = models.load(models.resolve(name))
    found = []
    for hold in sorted({hold for _, _, hold in PATHS}):
        request = {"nbatch": None, "nstep": None, "hold": hold, "largest": 1}
        nbatch, nstep, _ = measure.sizes(model, request)
        work = workload.make(model, nbatch, nstep, hold)
        resources = paths.Resources(work)
        run, reference = c_loop(library, work)
        run()
        reference = reference.copy()
        chosen = [(paths.find(p), options) for p, options, h in PATHS if h == hold]
        contenders = [timing.Contender(_nothing, run, _nothing)]
        for path, options in chosen:
            prepared = path.prepare(work, options, resources)
            _check(prepared.verify(), reference, model, path.name)
            contenders.append(timing.Contender(prepared.clear, prepared.run, _nothing))
        for contender in contenders:
            timing.block_s(contender)
        share = budget_s * len(chosen) / len(PATHS)
        samples = np.array(list(timing.rounds(contenders, share, 20, most)))
        for column, (path, _) in enumerate(chosen, 1):
            estimate = stats.speedup(list(samples[:, column]), list(samples[:, 0]))
            found.append((path.name, 1e9 * np.median(samples[:, column]) / work.steps, estimate))
        resources.close()
    return found


def _check(states: paths.States, reference: np.ndarray, model: Any, name: str) -> None:
    columns = compat.state_columns(model, compat.state_spec("INTEGRATION"))
    difference = agreement.first_difference(states.values, reference, columns, states.held)
    if difference:
        raise MachineError(f"{name} and the C program disagree: {difference}")


def _nothing() -> None:
    pass


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    parser.add_argument("--budget", type=float, default=15.0, help="seconds per model")
    parser.add_argument("--rounds", type=int, default=400, help="rounds at most")
    given = parser.parse_args(words)
    try:
        with tempfile.TemporaryDirectory() as folder:
            library = build(Path(folder))
            print(f"{'model':18} {'path':18} {'ns/step':>10} {'over C':>8}  95 %")
            for name in given.models or models.shipped():
                for path, step_ns, ratio in ratios(library, name, given.budget, given.rounds):
                    print(
                        f"{name:18} {path:18} {step_ns:10,.0f} {ratio.median:8.4f}"
                        f"  {ratio.low:.4f}–{ratio.high:.4f}",
                        flush=True,
                    )
    except MjbenchError as error:
        sys.exit(f"c_floor: {error}")


if __name__ == "__main__":
    main()
