"""Which Node runs MuJoCo's WebAssembly builds, and whether it is new enough."""

import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError, MachineError, one_line, shown

# The command that is looked for, unless the user names another.
COMMAND = "node"
_PIN = Path(__file__).with_name("package.json")
# A Node that does not say its version within so many seconds does not work.
_LIMIT_S = 30.0


@dataclass(frozen=True)
class Node:
    """An installed Node; its version is such as `20.20.2`."""

    file: Path
    version: str


def oldest() -> int:
    """Return the oldest major version that will do."""
    wanted = json.loads(_PIN.read_text(encoding="utf-8"))["engines"]["node"]
    return int(wanted.removeprefix(">="))


def find(command: str = COMMAND, limit_s: float = _LIMIT_S) -> Node:
    """Return the Node of a command, which may be a path.

    Raises:
      InputError: there is no such program, and it is not `node`.
      MachineError: Node is missing, too old, or does not work.
    """
    file = shutil.which(command)
    if file is None:
        if command == COMMAND:
            raise MachineError(
                f"Node is not installed: install Node.js {oldest()} or newer with its npm, or name"
                " it by --node"
            )
        raise InputError(f"--node: there is no program {shown(command)}")
    version = _version(file, limit_s)
    if int(version.partition(".")[0]) < oldest():
        raise MachineError(
            f"{file} is Node {version}; MuJoCo's WebAssembly builds need {oldest()} or newer"
        )
    return Node(Path(file).absolute(), version)


def _version(file: str, limit_s: float) -> str:
    """Return the version that a program says.

    Raises:
      MachineError: it says none.
    """
    try:
        done = subprocess.run(
            [file, "--version"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise MachineError(f"{file} did not say its version within {limit_s:g} s") from None
    except OSError as error:
        raise MachineError(f"cannot run {file}: {one_line(error)}") from error
    said = done.stdout.decode(errors="replace").strip()
    match = re.fullmatch(r"v(\d+\.\d+\.\d+\S*)", said)
    if match is None or done.returncode:
        output = one_line(said or done.stderr.decode(errors="replace"), 100)
        raise MachineError(f"{file} is not Node: `--version` printed {output!r}")
    return match[1]
