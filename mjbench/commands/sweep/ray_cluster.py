"""A matrix of mjbench commands on the nodes of a Ray cluster; each result is a run file.

A plan has one command, and values for what it leaves open. Each combination of values, on each
machine, is a cell: one Ray task, which takes all processors of its node, runs the command there and
returns the run file. Ray decides where a task runs, and runs it again if its node dies.
"""

import contextlib
import hashlib
import itertools
import logging
import math
import os
import re
import secrets
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from mjbench import extras
from mjbench.errors import InputError, MachineError, MjbenchError, describe, one_line, reason, shown
from mjbench.host import child, files, machine
from mjbench.status import ExitCode, Status

# The label of a node that has the name of its machine.
LABEL = "mjbench-machine"
_MOST_CELLS = 10_000
_MOST_BYTES = 1_000_000
# How long a cluster may take to accept a connection, in seconds.
_CONNECT_S = 10.0
# Ray gives its workers a low priority, and hides accelerators that a task did not ask for.
_WORKER_ENVIRONMENT = {"RAY_worker_niceness": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
_OPEN = re.compile(r"\{([\w-]+)\}")

_Text = Annotated[str, Meta(min_length=1, max_length=1000)]
_Values = Annotated[list[_Text | int | float], Meta(min_length=1, max_length=1000)]


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What to measure, and where.

    Attributes:
      command: of mjbench; `{model}` in it stands for each value of `model` in `matrix`.
      machines: labels of nodes, each of which measures all cells; empty for any node, once.
      folder: in which commands run, relative to the plan; nodes get a copy of it.
      retries: how often a cell begins again if its node dies.
    """

    command: Annotated[str, Meta(pattern=r"\S", max_length=1000)]
    matrix: dict[_Text, Any] = {}
    machines: Annotated[list[_Text], Meta(max_length=1000)] = []
    folder: str = ""
    retries: Annotated[int, Meta(ge=0, le=100)] = 2


@dataclass(frozen=True)
class Cell:
    """One command on one machine; on any machine if `machine` is empty."""

    words: tuple[str, ...]
    machine: str = ""

    @property
    def command(self) -> str:
        return shlex.join(["mjbench", *self.words])

    @property
    def file_name(self) -> str:
        """The name of its run file; another command or machine has another one."""
        digest = hashlib.sha256("\0".join([self.machine, *self.words]).encode()).hexdigest()
        name = re.sub(r"[^A-Za-z0-9.]+", "-", " ".join(filter(None, [self.machine, *self.words])))
        return f"{name[:80].strip('-.')}-{digest[:10]}.jsonl"


@dataclass(frozen=True)
class CellResult:
    """How a command ended on a node.

    Attributes:
      content: of its run file; empty if it failed, and then `detail` says why.
    """

    status: Status
    detail: str = ""
    content: bytes = b""


def load(path: Path, check: Callable[[Sequence[str]], None]) -> tuple[Plan, list[Cell]]:
    """Return a plan and its cells; an InputError names the key that is wrong.

    Args:
      check: raises InputError for a command line that is wrong.
    """
    key = ""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise InputError(f"a plan has at most {_MOST_BYTES:,} bytes")
        plan = msgspec.toml.decode(content, type=Plan)
        key = "command: "
        words = shlex.split(plan.command)
        values: dict[str, list[str]] = {}
        for name, given in plan.matrix.items():
            key = f"matrix.{name}: "
            values[name] = list(dict.fromkeys(map(str, msgspec.convert(given, type=_Values))))
        for name in sorted(values.keys() ^ set(_OPEN.findall(" ".join(words)))):
            key = f"matrix.{name}: "
            raise InputError(f"give it values in [matrix], and name it in the command: {{{name}}}")
        machines = list(dict.fromkeys(plan.machines)) or [""]
        if math.prod(map(len, values.values())) * len(machines) > _MOST_CELLS:
            key = "matrix: "
            raise InputError(f"the plan asks for more than {_MOST_CELLS} results")
        key = "folder: "
        lines = []
        with contextlib.chdir(path.parent / plan.folder):
            for each in itertools.product(*values.values()):
                chosen = dict(zip(values, each, strict=True))
                lines.append(tuple(_filled(word, chosen) for word in words))
                key = f"command: {shlex.join(lines[-1])}: "
                check(lines[-1])
    except (msgspec.MsgspecError, MjbenchError, OSError, ValueError) as error:
        text = reason(error) if isinstance(error, OSError | ValueError) else one_line(error)
        raise InputError(f"{path}: {key}{text}") from None
    return plan, [Cell(line, machine) for machine in machines for line in lines]


def _filled(word: str, values: Mapping[str, str]) -> str:
    return _OPEN.sub(lambda match: values[match[1]], word)


@contextlib.contextmanager
def cluster(address: str | None, sent: Path | None = None) -> Iterator[None]:
    """Connect to a Ray cluster, or start Ray on this machine alone; end that at the end.

    Args:
      sent: folder that nodes get a copy of, in which tasks then run.
    """
    extras.require("mjbench sweep", "ray", ["ray"])
    if address is None and "ray" not in sys.modules:  # others on this machine may not use it
        os.environ.update(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=secrets.token_hex(32))
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    name = os.environ.get(machine.LABEL_VARIABLE)
    alone: dict[str, Any] = {"include_dashboard": False, "labels": {LABEL: name} if name else {}}
    handler = signal.getsignal(signal.SIGTERM)
    try:
        host, _, port = (address or "").rpartition(":")
        if port.isdecimal():  # where nothing listens, Ray would try for minutes
            socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S).close()
        ray.init(
            address or "local",
            runtime_env={
                "env_vars": _WORKER_ENVIRONMENT,
                **({"working_dir": str(sent)} if sent else {}),
            },
            log_to_driver=False,
            logging_level=logging.CRITICAL,
            **({} if address else alone),
        )
    except Exception as error:  # Ray does not document which
        where = f"connect to {address}" if address else "start on this machine"
        raise MachineError(f"Ray cannot {where}: {describe(error)}") from error
    finally:
        signal.signal(signal.SIGTERM, handler)  # Ray has one of its own
    try:
        yield
    finally:
        ray.shutdown()


def measure(
    planned: Sequence[Cell], retries: int = 0, folder: Path | None = None
) -> Iterator[tuple[Cell, CellResult]]:
    """Have a cluster measure cells; yield each as it ends.

    Args:
      folder: in which commands run; None for that of the tasks.

    Raises:
      InputError: no node has the label of a machine.
    """
    import ray

    machines = dict.fromkeys(cell.machine for cell in planned)
    processors = {name: _processors(ray.nodes(), name) for name in machines}
    tasks = {}
    for cell in planned:
        placed = {"label_selector": {LABEL: cell.machine}} if cell.machine else {}
        task = ray.remote(run_cell).options(
            num_cpus=processors[cell.machine],
            max_retries=retries,
            scheduling_strategy="SPREAD",
            **placed,
        )
        tasks[task.remote(cell, folder)] = cell
    while tasks:  # those that remain end with the connection
        (ended, *_), _ = ray.wait(list(tasks))
        try:
            result = ray.get(ended)
        except Exception as error:  # Ray does not document which
            result = CellResult(Status.CRASHED, describe(getattr(error, "cause", error)))
        yield tasks.pop(ended), result


def _processors(nodes: Sequence[Mapping[str, Any]], label: str) -> float:
    """Return the processors of the largest node with a label; no two tasks fit into one node."""
    alive = [node for node in nodes if node["Alive"]]
    fitting = [node for node in alive if not label or node["Labels"].get(LABEL) == label]
    processors = max((float(node["Resources"].get("CPU", 0)) for node in fitting), default=0.0)
    if processors >= 1:
        return processors
    if not label:
        raise MachineError("no node of the Ray cluster has a processor")
    raise InputError(
        f"machines: no node of the cluster is {shown(label)}; name it so by"
        f" `ray start --labels {LABEL}={label}`"
    )


def run_cell(cell: Cell, folder: Path | None = None) -> CellResult:
    """Run a command on this node; what it has started ends with it, and with this process."""
    label = {machine.LABEL_VARIABLE: cell.machine} if cell.machine else {}
    with files.temporary_folder() as temporary, child.adoption():
        results, log = temporary / "runs", temporary / "errors.txt"
        storing = [cell.words[0], "--results", str(results), *cell.words[1:]]
        with log.open("wb") as errors:
            process = child.Child(
                child.ending_with_parent([sys.executable, "-P", "-m", "mjbench", *storing]),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                cwd=folder,
                env={**os.environ, **label},
            )
        try:
            process.wait()
        finally:
            code = process.end()
        file = next(results.glob("*.jsonl"), None)
        if file is not None and code in (ExitCode.OK, ExitCode.FINDING):
            return CellResult(Status.OK, content=file.read_bytes())
        lines = machine.read_text(log).splitlines()
        detail = lines[-1].removeprefix("mjbench: ") if lines else child.describe_exit(code)
        status = Status.INPUT if code == ExitCode.USAGE else Status.FAILED
        return CellResult(Status.CRASHED if code < 0 else status, one_line(detail))
