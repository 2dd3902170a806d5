"""Why do MuJoCo's WebAssembly builds differ from C: is it the mathematics library alone?

    python -m benchmarks.studies.web_mathematics [MODEL …]

The builds have the sines, cosines, exponentials and so on of musl, the C library of Emscripten; C
has those of this system's. The program runs `mjbench web` twice: as it is, and with a library of
these functions of musl that C loads before its own. The table has the first difference of the first
build from C, in both runs. Where the second is `identical`, nothing else makes a difference.

It needs Linux, a C compiler (cc), and musl's libc.a (Debian's package musl-dev).
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.studies import tally_command
from mjbench.errors import MachineError, one_line
from mjbench.simulation import models
from mjbench.status import ExitCode

# The functions that libmujoco takes from the mathematics library, and what they need of musl.
_FUNCTIONS = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "pow")
_PARTS = (
    *("__sin", "__cos", "__tan", "__rem_pio2", "__rem_pio2_large", "exp_data", "log_data"),
    *("pow_data", "scalbn", "floor", "fabs", "sqrt", "__math_divzero", "__math_invalid"),
    *("__math_oflow", "__math_uflow", "__math_xflow"),
)
_ARCHIVES = "/usr/lib/*-linux-musl/libc.a"


@dataclass(frozen=True)
class ModelDifference:
    """How a build differs from C on a model.

    Attributes:
      as_it_is: steps after which a state differs first; None where all are identical to the last
        bit.
      with_musl: the same with musl's functions in C.
      difference: the largest over the run.
    """

    model: str
    as_it_is: int | None
    with_musl: int | None
    difference: float


def archive() -> Path:
    """Return musl's C library."""
    archives = sorted(Path("/").glob(_ARCHIVES.lstrip("/")))
    if not archives:
        raise MachineError("musl's libc.a is missing: apt-get install musl-dev")
    return archives[0]


def build(folder: Path) -> Path:
    """Return a library with musl's mathematical functions, built in a folder."""
    if not shutil.which("cc") or not shutil.which("ar"):
        raise MachineError("no C compiler (cc) on this machine")
    objects = [f"{name}.lo" for name in (*_FUNCTIONS, *_PARTS)]
    library = folder / "musl_mathematics.so"
    for command in (
        ["ar", "x", str(archive()), *objects],
        ["cc", "-shared", "-o", str(library), *objects],
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise MachineError(f"{command[0]} failed: {one_line(done.stderr)}")
    return library


def compared(plain: Mapping[str, Any], with_musl: Mapping[str, Any]) -> list[ModelDifference]:
    """Return how the first build differs, from two documents of `mjbench web`."""
    pairs = zip(plain["results"], with_musl["results"], strict=True)
    return [
        ModelDifference(
            before["model"],
            _first_step(before),
            _first_step(after),
            _check(before)["points"][-1]["difference"],
        )
        for before, after in pairs
    ]


def _first_step(row: Mapping[str, Any]) -> int | None:
    first = _check(row)["first"]
    return None if first is None else int(first["step"])


def _check(row: Mapping[str, Any]) -> Mapping[str, Any]:
    checks = [path["check"] for path in row["paths"] if path["check"] is not None]
    if not checks:
        raise MachineError(f"{row['model']} was not compared: {row['detail']}")
    check: Mapping[str, Any] = checks[0]
    return check


def _measure(names: Sequence[str], folder: Path, environment: Mapping[str, str]) -> Any:
    """Return the document of `mjbench web`, run with further environment variables."""
    file = folder / "web.json"
    options = ["--budget", "0", "--results", str(folder), "--json", str(file)]
    command = [sys.executable, "-m", "mjbench", "web", *names, *options]
    done = subprocess.run(command, env={**os.environ, **environment}, check=False)
    if not file.is_file():
        raise MachineError(f"mjbench web ended with exit code {done.returncode}")
    return json.loads(file.read_text())


def main() -> ExitCode:
    """Compare, and print the table."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("names", nargs="*", metavar="MODEL")
    names = parser.parse_args().names or models.shipped()
    return tally_command.run("web_mathematics", lambda: _compare(names))


def _compare(names: Sequence[str]) -> ExitCode:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library = build(folder)
        plain = _measure(names, folder, {})
        (folder / "web.json").unlink()
        with_musl = _measure(names, folder, {"LD_PRELOAD": str(library)})
        rows = compared(plain, with_musl)
    print(f"\n{'model':20} {'first difference':18} {'largest':9} with musl's functions in C")
    for row in rows:
        largest = "0" if row.difference == 0 else f"{row.difference:.1e}"
        print(f"{row.model:20} {_when(row.as_it_is):18} {largest:9} {_when(row.with_musl)}")
    return ExitCode.OK


def _when(step: int | None) -> str:
    return "identical" if step is None else f"after step {step}"


if __name__ == "__main__":
    sys.exit(main())
