"""How to run Python code in the environment of one MuJoCo release.

The code sees mjbench, one release, NumPy and the standard library, and nothing else.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import mjbench
from mjbench.errors import writing

# Variables with these names pad arguments and environment: their bytes and their number become
# multiples of these.
_PADDING, _STACK_UNIT_BYTES, _POINTER_UNIT = "MJBENCH_PADDING", 1 << 15, 32


def link_mjbench(folder: Path) -> None:
    """Link the mjbench package alone into a folder.

    What lies beside the package (another MuJoCo, in a virtual environment) must not be found.
    """
    link = folder / "mjbench"
    with writing(link):
        link.symlink_to(Path(mjbench.__file__).resolve().parent)


def command(code: str, core: Path, install: Path | None) -> list[str]:
    """Return the command that runs Python code in the environment of a release."""
    if install is None:
        return [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(core)!r}); {code}"]
    folders = [str(core), str(install)]
    return [sys.executable, "-P", "-s", "-S", "-c", f"import sys; sys.path += {folders!r}; {code}"]


def environment(install: Path | None) -> dict[str, str]:
    """Return environment variables, without those that change how Python runs.

    PYTHONPATH stays only where no release is given.
    """
    variables = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    # nothing is drawn, and importing the window library is a third of importing MuJoCo
    variables["MUJOCO_GL"] = "disable"
    if install is None and "PYTHONPATH" in os.environ:
        variables["PYTHONPATH"] = os.environ["PYTHONPATH"]
    return variables


def padded(
    command: Sequence[str], variables: Mapping[str, str], stack_bytes: int
) -> dict[str, str]:
    """Return environment variables with some more, which decide where the stack begins.

    Arguments and environment lie at the top of the stack, texts above pointers to them. Where the
    kernel does not draw its address, a longer path of an install would make one target's stack
    begin elsewhere. The stack begins further down by `stack_bytes`, less than _STACK_UNIT_BYTES.
    """
    missing = -(len(command) + len(variables)) % _POINTER_UNIT or _POINTER_UNIT
    variables = {**variables, **{f"{_PADDING}{i}": "" for i in range(missing)}}
    texts = [*command, *(f"{name}={value}" for name, value in variables.items())]
    used = sum(len(os.fsencode(text)) + 1 for text in texts)
    return {**variables, f"{_PADDING}0": "x" * ((stack_bytes - used) % _STACK_UNIT_BYTES)}
