"""Which Node runs WebAssembly builds, and a process of it that steps one (see runner.mjs).

The process does what it is asked for in an empty folder, and dies with its parent. Requests and
answers are messages of JSON (see `child_connection`); arrays are in files, as float64 of this
processor.
"""

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.errors import Failure, InputError, MachineError, one_line, shown
from mjbench.host import child, child_connection
from mjbench.host.child_connection import ChildError
from mjbench.paired import cores
from mjbench.status import Status

_T = TypeVar("_T")
# What runner.mjs steps: files with start states and controls, as float64, and their sizes.
Steps = Mapping[str, object]
_RUNNER = Path(__file__).with_name("runner.mjs")
# The command that is looked for, unless the user names another.
COMMAND = "node"
_PIN = Path(__file__).with_name("package.json")
# A Node that does not say its version within so many seconds does not work.
_VERSION_LIMIT_S = 30.0


@dataclass(frozen=True)
class NodeProgram:
    """An installed Node; its version is such as `20.20.2`."""

    file: Path
    version: str


@dataclass(frozen=True)
class Instantiated:
    """A build that is ready.

    Attributes:
      instantiate_ms: to compile and instantiate its WebAssembly, workers included.
      has_threadpool: whether the engine can have a thread pool of its own.
    """

    version: str
    import_ms: NonNegativeFloat
    instantiate_ms: NonNegativeFloat
    heap_bytes: NonNegativeInt
    has_threadpool: bool


@dataclass(frozen=True)
class Memory:
    """Memory of a Node process; the resident one is of the whole process."""

    heap_bytes: NonNegativeInt
    rss_bytes: NonNegativeInt


class NodeError(MachineError):
    """A Node process failed, crashed or hung; the message names it, `failure` does not."""

    def __init__(self, name: str, failure: Failure):
        super().__init__(f"{name}: {failure.detail}")
        self.status = failure.status
        self.failure = failure


class NodeProcess:
    """A process of Node that runs our program.

    What it is asked for raises NodeError where that fails, or where the process crashes or does not
    answer in time.
    """

    def __init__(self, node: NodeProgram, name: str, folder: Path, limit_s: float):
        """Start the process; the folder is an empty one, for what it prints."""
        self.name, self.limit_s = name, limit_s
        self._failure: Failure | None = None
        # elsewhere the end of its connection ends it
        die_with_parent = (
            partial(child.die_with_parent, os.getpid()) if sys.platform == "linux" else None
        )
        self._answers = child_connection.start(
            lambda descriptor: [str(node.file), str(_RUNNER), str(descriptor)],
            folder / "output.txt",
            limit_s,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            preexec_fn=die_with_parent,
        )

    @property
    def pid(self) -> int:
        return self._answers.process.pid

    def instantiate(self, script: Path, nthread: int) -> Instantiated:
        arguments = {"script": str(script), "nthread": nthread}
        return self._call(Instantiated, "instantiate", "instantiating the module", **arguments)

    def load(self, files: Sequence[str], engine_threads: int) -> float:
        """Compile a model, whose own file is the first; return the milliseconds that it took."""
        pairs = [(Path(file).absolute().as_posix(), file) for file in files]
        model = pairs[0][0]
        arguments = {"files": pairs, "model": model, "engine_threads": engine_threads}
        return self._call(float, "load", "loading the model", **arguments)

    def record(self, steps: Steps, points: Sequence[int], states_file: Path) -> None:
        arguments = {**steps, "points": list(points), "states_file": str(states_file)}
        self._call(type(None), "record", "stepping the model", **arguments)

    def prepare(self, steps: Steps) -> None:
        self._call(type(None), "prepare", "preparing a run", **steps)

    def time_block(self) -> int:
        ns = self._call(int, "block", "running a block")
        if ns <= 0:
            detail = f"reports that a block took {ns} ns"
            raise NodeError(self.name, Failure(Status.FAILED, detail))
        return ns

    def save(self, states_file: Path) -> None:
        self._call(type(None), "save", "saving states", states_file=str(states_file))

    def memory(self) -> Memory:
        return self._call(Memory, "memory", "measuring memory")

    def confine(self, allowed: Collection[int]) -> None:
        """Have the thread that steps run on these cores only; compilers of Node are others."""
        cores.confine([self.pid], allowed)

    def end(self) -> None:
        self._answers.end()

    def _call(self, kind: type[_T], action: str, activity: str, **arguments: object) -> _T:
        if self._failure is not None:
            raise NodeError(self.name, self._failure)
        with contextlib.suppress(OSError):  # its end is reported where its answer is read
            content = json.dumps({"action": action, **arguments})
            self._answers.connection.send_bytes(content.encode())
        try:
            return self._answer(kind, activity)
        except ChildError as error:
            self._failure = Failure(error.ending, str(error))
            raise NodeError(self.name, self._failure) from None

    def _answer(self, kind: type[_T], activity: str) -> _T:
        import msgspec  # late: asv's environments lack it

        content = self._answers.receive(self.limit_s, activity)
        try:
            answer = json.loads(content)
            if "error" in answer:
                detail = f"{one_line(answer['error'])} while {activity}"
                raise NodeError(self.name, Failure(Status.FAILED, detail))
            return msgspec.convert(answer["value"], kind)
        except (ValueError, TypeError, KeyError):
            raise self._answers.invalid(content, activity) from None


def _oldest_node() -> int:
    wanted = json.loads(_PIN.read_text(encoding="utf-8"))["engines"]["node"]
    return int(wanted.removeprefix(">="))


def find_node(command: str = COMMAND, limit_s: float = _VERSION_LIMIT_S) -> NodeProgram:
    file = shutil.which(command)
    if file is None:
        if command == COMMAND:
            raise MachineError(
                f"Node is not installed: install Node.js {_oldest_node()} or newer with its npm,"
                " or name it by --node"
            )
        raise InputError(f"--node: there is no program {shown(command)}")
    version = _version(file, limit_s)
    if int(version.partition(".")[0]) < _oldest_node():
        raise MachineError(
            f"{file} is Node {version}; MuJoCo's WebAssembly builds need {_oldest_node()} or newer"
        )
    return NodeProgram(Path(file).absolute(), version)


def _version(file: str, limit_s: float) -> str:
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
