"""What goes wrong with the memory of MuJoCo's WebAssembly builds, and how often their sines differ.

    python -m benchmarks.studies.web_memory [--package DIR] [--node COMMAND]

web_memory.mjs says what is tried, on each build, in Node processes of their own. Sines and cosines
of the builds are compared with those of this system's C library. docs/guides/browser.md says what
follows, and what to write instead.
"""

import json
import math
import random
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.studies import tally_command
from mjbench.errors import MachineError, one_line
from mjbench.simulation import models
from mjbench.status import ExitCode
from mjbench.web import node_process, npm_package
from mjbench.web.node_process import NodeProgram
from mjbench.web.npm_package import Build, NpmPackage

_SCRIPT = Path(__file__).with_suffix(".mjs")
# Angles whose sines and cosines are compared, in rad up to this.
_COUNT, _LARGEST = 2000, math.pi
_LIMIT_S = 300.0


def examine(package: NpmPackage, program: NodeProgram, build: Build) -> dict[str, Any]:
    """Return what was tried with a build, and what happened."""
    rng = random.Random(0)
    angles = [rng.uniform(-_LARGEST, _LARGEST) for _ in range(_COUNT)]
    script, cartpole = str(package.script(build)), str(models.resolve("cartpole").path)
    examined = _run(program, "examine", script, cartpole, json.dumps(angles))
    quaternions = examined.pop("quaternions")
    return {
        "build": build,
        "release": package.version,
        "node": program.version,
        "examined": examined,
        "limits": _run(program, "fill", script)["limits"],
        "mathematics": mathematics(angles, quaternions),
    }


def _run(program: NodeProgram, *arguments: str) -> dict[str, Any]:
    """Return what web_memory.mjs writes in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "output.json")
        command = [str(program.file), "--expose-gc", str(_SCRIPT), str(output), *arguments]
        try:
            subprocess.run(command, capture_output=True, check=True, timeout=_LIMIT_S)
        except subprocess.SubprocessError as error:
            raise MachineError(f"{arguments[0]} failed: {one_line(error)}") from error
        written: dict[str, Any] = json.loads(output.read_text())
        return written


def mathematics(
    angles: Sequence[float], quaternions: Sequence[tuple[float, float, float, float]]
) -> dict[str, float]:
    """Return how often sines and cosines differ from those of this system's C library.

    The engine computes the cosine and the sine of half of an angle for its quaternion, the first
    and the last entry (`mju_axisAngle2Quat`).

    Args:
      angles: in rad.
      quaternions: of rotations by them.
    """
    sines = cosines = 0
    largest = 0.0
    for angle, (cosine, _, _, sine) in zip(angles, quaternions, strict=True):
        in_c = math.cos(0.5 * angle), math.sin(0.5 * angle)
        cosines += cosine != in_c[0]
        sines += sine != in_c[1]
        largest = max(largest, abs(cosine - in_c[0]), abs(sine - in_c[1]))
    return {"count": len(angles), "sines": sines, "cosines": cosines, "difference": largest}


def main() -> ExitCode:
    """Try all of it with both builds, and print what happened, as JSON."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--package", type=Path, metavar="DIR")
    parser.add_argument("--node", default="node", metavar="COMMAND")
    options = parser.parse_args()

    def action() -> ExitCode:
        package = npm_package.find(folder=options.package)
        program = node_process.find_node(options.node)
        tried = [examine(package, program, build) for build in Build]
        print(json.dumps(tried, indent=1))
        return ExitCode.OK

    return tally_command.run("web_memory", action)


if __name__ == "__main__":
    sys.exit(main())
