"""Measures MJX and Warp on this machine's GPU, beside mjwarp-testspeed and programs by hand.

    python -m benchmarks.studies.gpu [MODEL …] [--nbatch 1,1024,8192] [--paths NAME,…]
        [--output FOLDER]

compares C, MJX and Warp on each model with `mjbench compare`, whose run files go to FOLDER/runs,
and writes FOLDER/gpu.json, which grows with each figure: the GPU with its clocks before and after;
what mjwarp-testspeed measures for the same models, sizes and buffers; and the throughput of the
paths over programs by hand from the same states, of Warp also from those of mjwarp-testspeed. It
needs an NVIDIA GPU, `nvidia-smi`, and the extras `mjx` and `warp`.
"""

import dataclasses
import enum
import functools
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import mjx, stored
from benchmarks.studies import tally_command, tally_file
from benchmarks.studies.testspeed import noisy_keyframe
from mjbench import paths
from mjbench.errors import InputError, MachineError, MjbenchError
from mjbench.host import isolate
from mjbench.paths import warp_buffers
from mjbench.paths.accelerated import Compiled, accelerated_path
from mjbench.simulation import models, reference_run
from mjbench.simulation.workload import Workload, fields
from mjbench.status import ExitCode

RESULTS = Path(__file__).resolve().parents[2] / "results"
PATHS, NSTEP = "rollout,batch_rollout,mjx,mjx_warp,warp", 20
# Pairs of blocks, and the limit of one comparison with a program by hand, which compiles first.
ROUNDS, BY_HAND_LIMIT_S = 60, 300
# Of MJX: one that compiles in seconds.
MJX_MODEL = "cartpole"
# The start states of a program by hand: fields that these models' steps change.
_MOVING = ("qpos", "qvel", "act", "qacc_warmstart")
# What nvidia-smi says of each GPU.
_QUERY = "name,driver_version,clocks.sm,clocks.mem,clocks.max.sm,power.limit,temperature.gpu"


class Starts(enum.StrEnum):
    """Start states and controls: those of our benchmarks, or those of mjwarp-testspeed."""

    STORED = "stored"
    TESTSPEED = "testspeed"


@dataclass(frozen=True)
class Testspeed:
    """What mjwarp-testspeed measured: the mean of its steps, from keyframe 0 with noisy controls.

    Attributes:
      contacts: of a world, on average; `constraints` are those of the world with most.
      steps_ns: nanoseconds of each step, divided by the worlds; in the first one, the graph is
        loaded onto the GPU. Empty where only the mean is known.
    """

    model: str
    nworld: int
    ns_per_step: float
    compile_s: float
    contacts: float
    constraints: float
    solver_iterations: float
    steps_ns: tuple[float, ...] = ()


@dataclass(frozen=True)
class OverByHand:
    """Throughput of a path over that of a program by hand, the median of pairs of blocks.

    Attributes:
      starts: whose states and controls both step.
      path_ns_per_step: of the path's median block; None where only the ratio is known.
    """

    path: str
    model: str
    nbatch: int
    ratio: float
    starts: Starts = Starts.STORED
    path_ns_per_step: float | None = None


@dataclass(frozen=True)
class GpuTally:
    """What `benchmarks.studies.gpu` measured, beside its run files.

    Attributes:
      before: lines of nvidia-smi, one a GPU, as CSV; `after` is after all measurements.
      failures: a line for each figure that is not there.
    """

    before: tuple[str, ...]
    after: tuple[str, ...] = ()
    testspeed: tuple[Testspeed, ...] = ()
    over_by_hand: tuple[OverByHand, ...] = ()
    failures: tuple[str, ...] = ()


def gpus() -> tuple[str, ...]:
    """Return what nvidia-smi says of each GPU, a line of CSV each.

    Raises:
      MachineError: there is none.
    """
    command = shutil.which("nvidia-smi")
    if command is None:
        raise MachineError("there is no GPU here: nvidia-smi was not found")
    done = subprocess.run(
        [command, f"--query-gpu={_QUERY}", "--format=csv,noheader"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or not done.stdout.strip():
        raise MachineError("there is no GPU here: nvidia-smi lists none")
    return tuple(done.stdout.splitlines())


def compare(name: str, nbatch: str, path_names: str, folder: Path) -> None:
    """Compare the paths on a model, and write a run file.

    Raises:
      MachineError: the command failed.
    """
    flags = ["--paths", path_names, "--nbatch", nbatch, "--nstep", str(NSTEP)]
    command = [sys.executable, "-m", "mjbench", "compare", name, *flags, "--results", str(folder)]
    done = subprocess.run(command, check=False)
    if done.returncode:
        raise MachineError(f"mjbench compare {name} ended with exit code {done.returncode}")


def testspeed(name: str, nworld: int) -> Testspeed:
    """Return what mjwarp-testspeed measures of a model, with the path's buffers.

    Raises:
      MachineError: it failed, or its output has other names.
    """
    peaks = reference_run.observe(stored.stored_workload(name, nstep=NSTEP)).peaks
    sizes = warp_buffers.buffer_sizes(peaks, 1)
    flags = {
        "nworld": nworld,
        "nstep": NSTEP,
        "nconmax": sizes["naconmax"],
        "njmax": sizes["njmax"],
    }
    command = [sys.executable, "-m", "benchmarks.studies.testspeed", str(models.resolve(name).path)]
    command += [f"--{flag}={value}" for flag, value in flags.items()]
    done = subprocess.run([*command, "--format=json"], capture_output=True, text=True, check=False)
    printed = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode or len(printed) < 2:
        lines = f"{done.stdout}\n{done.stderr}".splitlines()
        reasons = [line for line in lines if line.strip() and not line.startswith("{")]
        raise MachineError(f"mjwarp-testspeed on {name} failed: {(reasons or ['no output'])[-1]}")
    metrics, steps = printed
    try:
        return Testspeed(
            name,
            nworld,
            1e9 / metrics["steps_per_second"],
            metrics["jit_duration"],
            metrics["ncon_mean"],
            metrics["nefc_mean"],
            metrics["solver_niter_mean"],
            tuple(1e9 * step_s / nworld for step_s in steps["steps_s"]),
        )
    except KeyError as missing:
        raise MachineError(f"this mjwarp-testspeed does not print {missing}") from missing


def warp_over_by_hand(name: str, nbatch: int, starts: Starts) -> OverByHand:
    """Time the path `warp` and the loop of mjwarp-testspeed on the same states, in turns."""
    return isolate.call(
        compare_warp_with_handwritten,
        name,
        nbatch,
        starts,
        limit_s=BY_HAND_LIMIT_S,
        environment=accelerated_path("warp").environment(),
    )


def compare_warp_with_handwritten(
    name: str, nbatch: int, starts: Starts, channel: isolate.Channel
) -> OverByHand:
    """Time both programs in turns; runs in a child process."""
    workload_of = stored.stored_workload if starts == Starts.STORED else noisy_keyframe
    workload = workload_of(name, nbatch, NSTEP)
    prepared = accelerated_path("warp").prepare(workload, {}, paths.Resources(workload))
    assert isinstance(prepared, Compiled)
    by_hand = _handwritten_warp(workload, prepared.buffer_sizes)
    path_s, by_hand_s = mjx.seconds_of_rounds(prepared, by_hand, ROUNDS).T
    path_ns = 1e9 * float(np.median(path_s)) / (nbatch * NSTEP)
    return OverByHand("warp", name, nbatch, float(np.median(by_hand_s / path_s)), starts, path_ns)


def _handwritten_warp(workload: Workload, sizes: Mapping[str, int]) -> Callable[[], None]:
    """Return a program that steps as mjwarp-testspeed does: it waits for each step."""
    import mujoco_warp
    import warp as wp

    model = mujoco_warp.put_model(workload.model)
    data = mujoco_warp.make_data(workload.model, nworld=workload.nbatch, **sizes)
    mujoco_warp.step(model, data)
    with wp.ScopedCapture() as capture:
        mujoco_warp.step(model, data)
    start = fields(workload.model, workload.initial_state)
    moving = {name: getattr(data, name) for name in _MOVING if name in start}
    values = {name: wp.array(start[name], dtype=wp.float32) for name in moving}
    controls = [wp.array(step, dtype=wp.float32) for step in workload.control.swapaxes(0, 1)]

    # the graph reads the model's arrays, and does not keep them alive
    def run(model: Any = model) -> None:
        for name, array in moving.items():
            wp.copy(array, values[name])
        for k in range(workload.nstep):
            if k % workload.hold == 0:
                wp.copy(data.ctrl, controls[k // workload.hold])
            wp.capture_launch(capture.graph)
            wp.synchronize()

    return run


def mjx_over_by_hand() -> OverByHand:
    """Time the path `mjx` and a handwritten program, in turns."""
    by_hand = mjx.ByHand()
    by_hand.setup()
    ratio = by_hand.track_throughput_over_handwritten()
    return OverByHand("mjx", MJX_MODEL, mjx.NBATCH, ratio)


def measurements(
    names: Sequence[str], nbatch: str, path_names: str, folder: Path
) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield what to measure, each after the name of the field of the tally that it goes to."""
    sizes = [int(size) for size in nbatch.split(",")]
    for name in names:
        yield "failures", functools.partial(compare, name, nbatch, path_names, folder)
        for size in sizes:
            yield "testspeed", functools.partial(testspeed, name, size)
        for starts in Starts:
            yield "over_by_hand", functools.partial(warp_over_by_hand, name, max(sizes), starts)
    yield "over_by_hand", mjx_over_by_hand


def run(names: Sequence[str], nbatch: str, path_names: str, output: Path) -> GpuTally:
    """Measure, and write the tally after each figure."""
    tally = GpuTally(gpus())
    output.mkdir(parents=True, exist_ok=True)
    for field, measure in measurements(names, nbatch, path_names, output / "runs"):
        try:
            value = measure()
        except (MjbenchError, NotImplementedError) as error:  # the latter for what is missing
            field, value = "failures", str(error)
        if value is not None:
            tally = dataclasses.replace(tally, **{field: (*getattr(tally, field), value)})
            _write(tally, output)
    tally = dataclasses.replace(tally, after=gpus())
    _write(tally, output)
    return tally


def _write(tally: GpuTally, output: Path) -> None:
    tally_file.write(output / "gpu.json", tally)


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--nbatch", default="1,1024,8192")
    parser.add_argument("--paths", default=PATHS)
    parser.add_argument("--output", type=Path, default=RESULTS)
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        names = options.models or models.shipped()
        if unknown := sorted(set(names) - set(models.shipped())):
            raise InputError(f"no such shipped model: {', '.join(unknown)}")
        tally = run(names, options.nbatch, options.paths, options.output)
        return ExitCode.FINDING if tally.failures else ExitCode.OK

    return tally_command.run("gpu", action, "what was measured is in gpu.json and the run files")


if __name__ == "__main__":
    sys.exit(main())
