"""Runs pip, above all to install a release into a folder, and says why it could not.

pip says "no matching distribution" when there is no such version, and also when the index cannot be
reached. Its output is for people, so the index is asked instead of parsing it.
"""

import contextlib
import logging
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from mjbench.errors import InputError, MachineError, one_line
from mjbench.host import child, files
from mjbench.releases import named_packages, release_names
from mjbench.status import ExitCode

_LOG = logging.getLogger(__name__)
# Seconds between two reports of how far it is.
_TICK_S = 0.5
# What pip says last where a wheel cannot be built, and the line that says why.
_BUILD_FAILED = "ERROR: Failed to build"
_OF_COMPILER = re.compile(r"\b(?:error|\w+Error): (?!subprocess-exited)")
# What says no more than the line before it.
_OF_RESOLVER = "ERROR: ResolutionImpossible"
# The variable that stands for a version which a build would ask git for: there is no repository.
_VERSION_OF_GIT = "SETUPTOOLS_SCM_PRETEND_VERSION"


class BuildError(MachineError):
    """Code of the user's cannot be built, or what it needs cannot be installed (exit code 4)."""

    exit_code = ExitCode.NOT_BUILT


def install(version: str, wheels: Sequence[Path], target: Path, beside: Sequence[str] = ()) -> None:
    """Install a release, from the index or from wheels, and this NumPy into a folder.

    Args:
      beside: requirements and wheels to install with what they need, perhaps another NumPy.

    Raises:
      InputError: the index has no such release for this Python.
      BuildError: what is to be beside the release cannot be installed with it.
      MachineError: pip failed, or the index cannot be reached.
    """
    is_numpy_beside = "numpy" in named_packages.names_of(beside)
    numpy = [] if is_numpy_beside else [f"numpy=={metadata.version('numpy')}"]
    names = ", ".join(Path(each).name for each in beside)
    problem = run(
        "install",
        f"--target={target}",
        *(f"--find-links={folder}" for folder in {wheel.parent for wheel in wheels}),
        *([str(wheel) for wheel in wheels] or [f"mujoco=={version}"]),
        *beside,
        *numpy,
        phase=f"installing MuJoCo {version}{f' with {names}' if names else ''}",
    )
    if problem and beside:
        raise BuildError(f"cannot install {names} with MuJoCo {version}: {problem}")
    if problem:
        raise _error(version, bool(wheels), problem)


def is_available(version: str) -> bool:
    """Return whether pip finds a version: it may be told to look elsewhere than on the index."""
    arguments = ("--dry-run", "--no-deps", "--ignore-installed", f"mujoco=={version}")
    return not run("install", *arguments, phase=f"looking for MuJoCo {version}")


def build(name: str, source: Path, target: Path) -> None:
    """Build the wheel of a source tree into a folder; BuildError if it cannot be built."""
    arguments = ("--no-deps", f"--wheel-dir={target}", str(source))
    if problem := run("wheel", *arguments, phase=f"building {name}"):
        raise BuildError(problem)


def run(command: str, *arguments: str, phase: str) -> str:
    """Run a command of pip that takes wheels alone; return why it failed, or nothing.

    pip ends with all that it started, such as a compiler. On Linux it also dies with this process,
    so that it cannot write on while another one installs. What it does, the `phase`, is logged.
    """
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    _LOG.info(phase)
    with files.temporary_folder() as folder, tempfile.TemporaryFile() as errors:
        process = child.Child(
            child.ending_with_parent(
                [
                    *(sys.executable, "-m", "pip", command, "--quiet", "--no-input"),
                    *("--disable-pip-version-check", "--only-binary=:all:"),
                    *arguments,
                ]
            ),
            env={_VERSION_OF_GIT: "0", **environment, "TMPDIR": str(folder)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
        )
        try:
            while process.wait(_TICK_S) is None:
                _LOG.debug("%s: %.0f MB", phase, _size_bytes(folder) / 1e6)
        finally:
            exit_code = process.end()
        errors.seek(0)
        return "" if exit_code == 0 else _reason(errors.read().decode(errors="replace"))


def _size_bytes(folder: Path) -> int:
    size_bytes = 0
    for parent, _, names in os.walk(folder):  # it passes over folders that have gone
        for name in names:
            with contextlib.suppress(OSError):
                size_bytes += Path(parent, name).lstat().st_size
    return size_bytes


def _reason(stderr: str) -> str:
    """Return the line of pip's output that says most, as it is."""
    lines = stderr.splitlines() or ["pip failed without a message"]
    if lines[-1].startswith(_BUILD_FAILED):  # of the compiler
        causes = (line for line in lines if _OF_COMPILER.search(line))
        return one_line(next(causes, lines[-1]).removeprefix("ERROR: "))
    errors = [
        line
        for line in lines
        if line.startswith("ERROR: ") and not line.endswith(":") and _OF_RESOLVER not in line
    ]
    return one_line((errors or lines)[-1].removeprefix("ERROR: "))


def _error(version: str, local: bool, reason: str) -> InputError | MachineError:
    try:
        unknown = release_names.missing([version])
    except MachineError as error:
        return MachineError(f"cannot install MuJoCo {version}: {error}; pip says: {reason}")
    if unknown and not local:
        return InputError(unknown[version])
    return MachineError(f"cannot install MuJoCo {version}: {reason}")
