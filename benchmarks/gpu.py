"""Measures MJX and Warp on this machine's GPU, beside mjwarp-testspeed and a JAX loop by hand.

    python -m benchmarks.gpu [MODEL …] [--nbatch 1,1024,8192]

compares C, MJX and Warp on each model with `mjbench compare`, whose run files go to results/runs,
and writes results/gpu.json: the GPU with its clocks before and after, the speed of
mjwarp-testspeed for the same models and sizes, and the ratio of the path `mjx` to a loop by hand on
1024 cart-poles. It needs an NVIDIA GPU, `nvidia-smi`, and the extras `mjx` and `warp`.
"""

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks import mjx
from benchmarks.studies import tally_command, tally_file
from mjbench.errors import MachineError
from mjbench.simulation import models
from mjbench.status import ExitCode

ROOT = Path(__file__).resolve().parent.parent
TALLY = ROOT / "results" / "gpu.json"
PATHS, NSTEP = "rollout,batch_rollout,mjx,mjx_warp,warp", 100
# What nvidia-smi says of each GPU.
_QUERY = "name,driver_version,clocks.sm,clocks.mem,clocks.max.sm,power.limit,temperature.gpu"


@dataclass(frozen=True)
class Testspeed:
    """What mjwarp-testspeed printed of a model, as JSON."""

    model: str
    nworld: int
    result: dict[str, object]


@dataclass(frozen=True)
class GpuTally:
    """What `benchmarks.gpu` measured, beside its run files.

    Attributes:
      before: lines of nvidia-smi, one a GPU, as CSV; `after` is after all measurements.
      over_by_hand: throughput of the path `mjx` over that of a loop by hand.
    """

    before: tuple[str, ...]
    after: tuple[str, ...]
    testspeed: tuple[Testspeed, ...]
    over_by_hand: float


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


def compare(names: Sequence[str], nbatch: str) -> None:
    """Compare the paths on each model; each writes a run file."""
    for name in names:
        words = [name, "--paths", PATHS, "--nbatch", nbatch, "--nstep", str(NSTEP)]
        subprocess.run([sys.executable, "-m", "mjbench", "compare", *words], cwd=ROOT, check=False)


def testspeed(name: str, nworld: int) -> Testspeed:
    """Return what mjwarp-testspeed measures of a model.

    Raises:
      MachineError: it failed.
    """
    command = [sys.executable, "-m", "mujoco_warp.testspeed", str(models.resolve(name).path)]
    flags = ["--nworld", str(nworld), "--nstep", str(NSTEP), "--format", "json"]
    done = subprocess.run([*command, *flags], capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.splitlines() or ["no output"]
        raise MachineError(f"mjwarp-testspeed on {name} failed: {lines[-1]}")
    return Testspeed(name, nworld, json.loads(done.stdout[done.stdout.index("{") :]))


def run(names: Sequence[str], nbatch: str) -> None:
    """Measure, and write the tally."""
    before = gpus()
    compare(names, nbatch)
    sizes = [int(size) for size in nbatch.split(",")]
    speeds = tuple(testspeed(name, size) for name in names for size in sizes)
    by_hand = mjx.ByHand()
    by_hand.setup()
    ratio = by_hand.track_throughput_over_handwritten()
    TALLY.write_text(tally_file.dumps(GpuTally(before, gpus(), speeds, ratio)), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*")
    parser.add_argument("--nbatch", default="1,1024,8192")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        run(options.models or models.shipped(), options.nbatch)
        return ExitCode.OK

    return tally_command.run("gpu", action, "run files have what was compared")


if __name__ == "__main__":
    sys.exit(main())
