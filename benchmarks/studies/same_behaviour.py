"""Does a program behave under `mjbench run` as it does under Python alone?

    python -m benchmarks.studies.same_behaviour [PROGRAM …]

runs each program of `odd_programs` both ways, and compares what it prints, its exit code and the
files that it leaves. The command fails where they differ.
"""

import difflib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import tally_command
from benchmarks.studies.odd_programs import ODD_PROGRAMS, OddProgram
from mjbench.host import machine
from mjbench.status import ExitCode

# Seconds that a program may take at most.
_LIMIT_S = 60.0
# Addresses differ from run to run, and so do threads' numbers.
_ADDRESS = re.compile(r"0x[0-9a-f]{6,}")
# What MuJoCo writes beside a program has the time of day.
_LOG = "MUJOCO_LOG.TXT"


@dataclass(frozen=True)
class Behaviour:
    """What is seen of a program from outside.

    Attributes:
      exit_code: 128 and the number of a signal that ended it, as a shell has it.
      files: files that it left, by path.
    """

    exit_code: int
    output: str
    error: str
    files: Mapping[str, bytes]


def plain(program: OddProgram, folder: Path) -> Behaviour:
    """Run a program by Python alone, in a folder of its own."""
    return _run([sys.executable, *program.arguments], program, folder)


def observed(program: OddProgram, folder: Path) -> Behaviour:
    """Run a program under `mjbench run`; the report is taken off what it printed."""
    with tempfile.TemporaryDirectory() as results:
        command = [
            sys.executable,
            "-m",
            "mjbench",
            "run",
            "--seconds",
            "none",
            "--results",
            results,
        ]
        seen = _run([*command, *program.arguments], program, folder)
    name = program.arguments[program.arguments[0] == "-m"]
    own, _, _ = seen.error.partition(f"\n{name}: ")
    lines = [line for line in own.splitlines(True) if not line.startswith("mjbench: another")]
    return Behaviour(seen.exit_code, seen.output, "".join(lines), seen.files)


def differences(program: OddProgram) -> Iterator[str]:
    """Yield what differs between both ways of running a program, by line."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "work"  # tracebacks hold its name, so it is the same
        first, second = plain(program, folder), observed(program, folder)
    if first.exit_code != second.exit_code:
        yield f"exit code {first.exit_code}, and {second.exit_code} under mjbench run"
    for kind in ("output", "error"):
        before, after = (
            _ADDRESS.sub("0x", getattr(seen, kind)).splitlines() for seen in (first, second)
        )
        names = kind, f"{kind} under mjbench run"
        yield from difflib.unified_diff(before, after, *names, lineterm="")
    for file in sorted(first.files.keys() | second.files.keys()):
        if first.files.get(file) != second.files.get(file):
            yield f"{file}: {first.files.get(file)!r}, and {second.files.get(file)!r}"


def _run(command: Sequence[str], program: OddProgram, folder: Path) -> Behaviour:
    shutil.rmtree(folder, ignore_errors=True)
    contents: dict[str, str | bytes] = {"program.py": program.text, **program.files}
    for path, content in contents.items():
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    inputs = {str(file) for file in folder.rglob("*") if file.is_file()}
    process = subprocess.Popen(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **program.environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # so that the terminal's Ctrl-C is not its own
    )
    stdout, begin = process.stdout, ""
    assert stdout is not None, "there is a pipe"
    if program.closes_output:
        stdout.close()
        process.stdout = None
    if program.signal_number is not None:
        while not begin.endswith("ready\n"):
            begin += stdout.readline()
        process.send_signal(program.signal_number)
    output, error = process.communicate(program.stdin, timeout=_LIMIT_S)
    files = {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file() and str(file) not in inputs and file.name != _LOG
    }
    code = process.returncode
    return Behaviour(code if code >= 0 else 128 - code, begin + (output or ""), error, files)


def main() -> None:
    """Print the programs that differ; fail where one does."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("programs", nargs="*", metavar="PROGRAM")
    names = parser.parse_args().programs or list(ODD_PROGRAMS)
    with ThreadPoolExecutor(machine.usable_cores()) as pool:
        listed = list(pool.map(lambda name: list(differences(ODD_PROGRAMS[name])), names))
    for name, lines in zip(names, listed, strict=True):
        if lines:
            print(f"{name}:", *lines, sep="\n  ")
    differing = sum(map(bool, listed))
    print(f"{len(names) - differing} of {len(names)} programs behave the same")
    sys.exit(ExitCode.FINDING if differing else ExitCode.OK)


if __name__ == "__main__":
    main()
