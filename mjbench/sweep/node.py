"""What runs on a node: a calibration, then an ordinary command of mjbench in a process of its own.

The command writes a run file there; each cell is sent as soon as its lines are complete. The
command ends with the process that started it. Nothing here knows Ray.
"""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mjbench.errors import Failure, MachineError, MjbenchError, one_line
from mjbench.host import child, files, machine
from mjbench.host.machine import Machine
from mjbench.simulation import models
from mjbench.status import ExitCode, Status
from mjbench.sweep import busy_node, model_files, results, software
from mjbench.sweep.busy_node import NodeRules, NodeState
from mjbench.sweep.cells import Cell
from mjbench.sweep.commands import CommandLine
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.results import CellResult, Collector
from mjbench.sweep.software import Software

# How often the run file is read, in seconds: this takes some microseconds beside timed blocks.
_POLL_S = 0.25
# Seconds between calibrations of a busy node, and for which a node whose command failed pauses: a
# broken node must not take all commands.
_PAUSE_S = 15.0
# The folder of the run file, in that of the command.
_RESULTS = "runs"
# The program: mjbench, which ends with the process whose id is its first argument.
_PROGRAM = (
    "import runpy, sys\n"
    "from mjbench.host import child\n"
    "child.die_with_parent(int(sys.argv.pop(1)))\n"
    "runpy.run_module('mjbench', run_name='__main__', alter_sys=True)\n"
)
# What the variables begin with that Ray sets for its workers, which are nothing to a command.
_FOREIGN_PREFIX = "RAY_"


@dataclass(frozen=True)
class Request:
    """What a node is to measure; without `rules`, it need not be quiet.

    Attributes:
      program: what runs the command line; empty for this version of mjbench.
    """

    cells: tuple[Cell, ...]
    line: CommandLine
    software: Software
    rules: NodeRules | None = None
    program: tuple[str, ...] = ()


@dataclass(frozen=True)
class NodeMeasurement:
    """A cell that a node has measured.

    Attributes:
      wall_s: seconds since the command began, or since its earlier cell.
      busy_s: seconds before that, in which the node was not quiet.
      objection: why it was not; empty where it was at once.
    """

    node: str
    label: str
    result: CellResult
    wall_s: float
    busy_s: float = 0.0
    objection: str = ""


class NotMeasuredError(Exception):
    """A command ended without all of its results; another attempt may help."""

    def __init__(self, failure: Failure, on: Machine):
        super().__init__(failure, on)  # so that it can be pickled
        self.failure, self.machine = failure, on


class BusyError(Exception):
    """A node did not become quiet: why, in one line."""


def describe() -> tuple[Software, Machine]:
    return software.installed(), machine.describe()


def measure(
    request: Request,
    *carried: CarriedModel,
    name: str = "",
    label: str = "",
    calibrate: Callable[[], NodeState] = busy_node.calibrate,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[NodeMeasurement]:
    """Measure, and yield the cells of a request in their order, each as soon as it is complete.

    When the iterator is closed, or an exception passes through, the command ends with all that it
    has started. It raises BusyError, or NotMeasuredError if the node has other software, too.
    """
    busy_s, objection = _wait_until_quiet(request.rules, calibrate, sleep)
    try:
        difference = software.difference(request.software, software.installed())
        if difference:
            raise MachineError(difference)
        with files.temporary_folder() as folder, child.adoption():
            begin = time.perf_counter()
            for result in _run(request, carried, label, folder):
                now = time.perf_counter()
                yield NodeMeasurement(name, label, result, now - begin, busy_s, objection)
                begin, busy_s, objection = now, 0.0, ""
    except (MjbenchError, NotMeasuredError) as error:
        sleep(_PAUSE_S)
        if isinstance(error, NotMeasuredError):
            raise
        raise NotMeasuredError(Failure(Status.FAILED, str(error)), machine.describe()) from None


def _wait_until_quiet(
    rules: NodeRules | None, calibrate: Callable[[], NodeState], sleep: Callable[[float], None]
) -> tuple[float, str]:
    busy_s, first = 0.0, ""
    while rules and (objection := busy_node.objection(calibrate(), rules.limits)):
        first = first or objection
        if busy_s + _PAUSE_S > rules.patience_s:
            raise BusyError(objection)
        sleep(_PAUSE_S)
        busy_s += _PAUSE_S
    return busy_s, first


def _run(
    request: Request, carried: tuple[CarriedModel, ...], label: str, folder: Path
) -> Iterator[CellResult]:
    work, log = folder / "work", folder / "errors.txt"
    work.mkdir()
    index = model_files.unpack(carried, folder / "models") if carried else None
    program = request.program or (sys.executable, "-c", _PROGRAM, str(os.getpid()))
    storing = ["--results", _RESULTS]  # in its folder, whose name is nobody's business
    if request.rules is not None:
        storing.append("--wait")
    with log.open("wb") as errors, (folder / "output.txt").open("wb") as output:
        process = child.Child(
            [*program, *request.line.arguments, *storing, "--", *request.line.operands],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=errors,
            cwd=work,
            env=environment(os.environ, label, index),
        )
    collector = Collector(request.cells)
    try:
        with contextlib.closing(_Tail(work / _RESULTS)) as tail:
            code = None
            while code is None:
                code = process.wait(_POLL_S)
                yield from collector.add(tail.read())
    finally:
        process.end()
    yield from collector.end(code)
    if collector.missing:
        detail = _last_line(log) or child.describe_exit(code)
        yield from _without_result(collector.missing, code, detail)


def _without_result(cells: Sequence[Cell], code: int, detail: str) -> Iterator[CellResult]:
    here = machine.describe()
    if code != ExitCode.USAGE:
        is_killed = code < 0 or code == ExitCode.INTERRUPTED
        raise NotMeasuredError(
            Failure(Status.CRASHED if is_killed else Status.FAILED, detail), here
        )
    yield from (results.failed(cell, Failure(Status.INPUT, detail), here) for cell in cells)


def environment(
    own: Mapping[str, str], label: str = "", carried_index: Path | None = None
) -> dict[str, str]:
    variables = {name: value for name, value in own.items() if not name.startswith(_FOREIGN_PREFIX)}
    root = str(Path(__file__).resolve().parents[2])
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, [root, own.get("PYTHONPATH", "")]))
    if label:
        variables[machine.LABEL_VARIABLE] = label
    if carried_index is not None:
        variables[models.CARRIED_VARIABLE] = str(carried_index)
    return variables


class _Tail:
    def __init__(self, folder: Path):
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._rest = b""

    def read(self) -> tuple[bytes, ...]:
        if self._file is None:
            path = next(self._folder.glob("*.jsonl"), None)
            if path is None:
                return ()
            self._file = path.open("rb")
        *lines, self._rest = (self._rest + self._file.read()).split(b"\n")
        return tuple(line + b"\n" for line in lines)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


def _last_line(log: Path) -> str:
    lines = child.text(log).strip().splitlines()
    return one_line(lines[-1].removeprefix("mjbench: ")) if lines else ""
