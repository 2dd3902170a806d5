"""What runs on a node: a calibration, then an ordinary command of mjbench in a process of its own.

The command writes a run file there; its lines are sent on as they are appended. It ends with the
process that started it, however that one ends. Nothing here knows Ray.
"""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO

from mjbench.errors import MachineError, MjbenchError, one_line
from mjbench.instrument import child, machine, scratch
from mjbench.simulation import carried_models
from mjbench.status import ExitCode
from mjbench.sweep import calibration, model_files, software
from mjbench.sweep.messages import Began, Finished, Lines, Message, NodeAnswer, Refused, Request
from mjbench.sweep.model_files import CarriedModel

# How often the run file is read, in seconds: this takes some microseconds beside timed blocks.
_POLL_S = 0.25
# The folder of the run file, in that of the command.
_RESULTS = "runs"
# The program: mjbench, which ends with the process whose id is its first argument.
_PROGRAM = (
    "import runpy, sys\n"
    "from mjbench.instrument import child\n"
    "child.die_with_parent(int(sys.argv.pop(1)))\n"
    "runpy.run_module('mjbench', run_name='__main__', alter_sys=True)\n"
)
# What the variables begin with that Ray sets for its workers, which are nothing to a command.
_FOREIGN_PREFIX = "RAY_"


def describe() -> NodeAnswer:
    """Return what this node is."""
    return NodeAnswer(software.installed(), machine.describe())


def measure(
    request: Request,
    *carried: CarriedModel,
    calibrate: Callable[[], calibration.NodeState] = calibration.calibrate,
    is_lost: Callable[[], bool] = lambda: False,
) -> Iterator[Message]:
    """Measure, and yield what there is to say as it comes; the last is `Refused` or `Finished`.

    When the iterator is closed, or an exception passes through, the command ends with all that it
    has started.

    Args:
      carried: the user's models that the command line names.
      calibrate: says what this machine has of its cores.
      is_lost: whether nobody hears this process any more; the command then ends.
    """
    begin = time.perf_counter()
    try:
        if request.limits is not None:
            reason = calibration.objection(calibrate(), request.limits)
            if reason:
                yield Refused(reason)
                return
        with scratch.folder() as folder, child.adoption():
            yield from _run(request, carried, folder, begin, is_lost)
    except MjbenchError as error:
        yield Finished(ExitCode.ENVIRONMENT, str(error), time.perf_counter() - begin)


def _run(
    request: Request,
    carried: tuple[CarriedModel, ...],
    folder: Path,
    begin: float,
    is_lost: Callable[[], bool],
) -> Iterator[Message]:
    """Run the command in a folder of its own."""
    work, log = folder / "work", folder / "errors.txt"
    work.mkdir()
    index = model_files.unpack(carried, folder / "models") if carried else None
    program = request.program or (sys.executable, "-c", _PROGRAM, str(os.getpid()))
    storing = ["--results", _RESULTS]  # in its folder, whose name is nobody's business
    if request.limits is not None:
        storing.append("--wait")
    command_begin = time.perf_counter()
    with log.open("wb") as errors, (folder / "output.txt").open("wb") as output:
        process = child.Child(
            [*program, *request.line.arguments, *storing, "--", *request.line.operands],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=errors,
            cwd=work,
            env=environment(os.environ, request.label, index),
        )
    try:
        yield Began()
        with contextlib.closing(_Tail(work / _RESULTS)) as tail:
            code = None
            while code is None:
                code = process.wait(_POLL_S)
                if is_lost():
                    raise MachineError("this process is no longer part of a cluster")
                if lines := tail.read():
                    yield Lines(lines)
    finally:
        process.end()
    now = time.perf_counter()
    yield Finished(code, _last_line(log), now - begin, now - command_begin)


def environment(
    own: Mapping[str, str], label: str = "", carried_index: Path | None = None
) -> dict[str, str]:
    """Return the environment of a command.

    Args:
      own: of this process.
      label: of the machine; empty to leave what is there.
      carried_index: list of the user's models; None without any.
    """
    variables = {name: value for name, value in own.items() if not name.startswith(_FOREIGN_PREFIX)}
    root = str(Path(__file__).resolve().parents[2])
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, [root, own.get("PYTHONPATH", "")]))
    if label:
        variables[machine.LABEL_VARIABLE] = label
    if carried_index is not None:
        variables[carried_models.VARIABLE] = str(carried_index)
    return variables


class _Tail:
    """Reads what is appended to the one run file of a folder, whole lines only."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._rest = b""

    def read(self) -> tuple[bytes, ...]:
        """Return the lines that are complete since the last call."""
        if self._file is None:
            path = next(self._folder.glob("*.jsonl"), None)
            if path is None:
                return ()
            self._file = path.open("rb")
        *lines, self._rest = (self._rest + self._file.read()).split(b"\n")
        return tuple(line + b"\n" for line in lines)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def _last_line(log: Path) -> str:
    """Return the last line that a command wrote to standard error, without its name."""
    lines = child.text(log).strip().splitlines()
    return one_line(lines[-1].removeprefix("mjbench: ")) if lines else ""
