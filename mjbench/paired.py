"""Two sides, alternated block by block in fresh processes: the engine of every comparison.

A launch is a process of each side with memory laid out anew. Both sit on one core, with this
process, and take turns in quads, ABBA or BAAB at random, so that drift and the order of turns hit
both alike. A launch gives one number, the middle of its quads' log ratios; launches are the
samples of which stats makes a verdict, and as many are made as the verdict needs.

This module runs on NumPy alone; only a verdict (stats) needs SciPy.
"""

import contextlib
import itertools
import os
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle
from pathlib import Path
from typing import Any

import numpy as np

import mjbench
from mjbench import agreement, installs, isolate, machine, worker
from mjbench.errors import InputError, MachineError
from mjbench.models import Source

# A block is about this long, in seconds: short blocks make close pairs. Steps of one simulation.
BLOCK_S, MOST_NSTEP = 0.002, 100
# The timed part of a launch, in seconds, and the fewest and most quads it is made of.
LAUNCH_S, LEAST_QUADS, MOST_QUADS = 0.08, 4, 30
# Paths with threads get blocks in which starting the threads is no longer what is measured.
THREADED_BLOCK_S = 0.01
# Warm processes of each release, used in turns.
WARM = 4


class SideError(MachineError):
    """A side crashed, hung or answered nonsense; tells which in one line."""


@dataclass(frozen=True)
class Side:
    """What one of the two sides runs.

    Attributes:
      release: of MuJoCo.
      model: to load.
      path: way of stepping.
      options: of the path.
      model_options: fields of `model.opt` to set, by name.
      slowdown: share of the simulations done once more, a slowdown of known size.
    """

    release: installs.Wanted
    model: Source
    path: str = "python_loop"
    options: Mapping[str, Any] = field(default_factory=dict)
    model_options: Mapping[str, str] = field(default_factory=dict)
    slowdown: float = 0.0

    @property
    def parallel(self) -> bool:
        """Return whether it uses more than one core."""
        return max(self.options.get(name, 1) or 1 for name in _THREAD_OPTIONS) > 1

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return {
            "release": self.release.version,
            "model": self.model.name,
            "path": self.path,
            "options": dict(self.options),
            "model_options": dict(self.model_options),
            "slowdown": self.slowdown,
        }


_THREAD_OPTIONS = ("threads", "processes", "engine_threads")


@dataclass(frozen=True)
class Sizes:
    """The work of a block; None is chosen from what a step costs."""

    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Launch:
    """What one launch measured.

    Attributes:
      warm: number of the warm processes it was forked from.
      core: that both sides ran on; None where they may use all.
      cores: that as many threads as the sides have got just before; None for one thread.
      orders: of each quad, `ABBA` or `BAAB`; A is the old side.
      ns: (quads, 4) nanoseconds of each block, in the order they ran.
    """

    warm: int
    core: int | None
    cores: float | None
    orders: Sequence[str]
    ns: np.ndarray

    def log_ratios(self) -> np.ndarray:
        """(quads,) natural logarithm of new time over old time."""
        logs = np.log(self.ns)
        sign = np.array([[1 if c == "B" else -1 for c in order] for order in self.orders])
        return np.asarray((logs * sign).sum(axis=1) / 2)

    @property
    def value(self) -> float:
        """The launch's log ratio: the median over its quads."""
        return float(np.median(self.log_ratios()))

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return asdict(self) | {"ns": self.ns.tolist()}


@dataclass(frozen=True)
class Same:
    """Whether both sides do the same work.

    Attributes:
      old: contacts, constraints, solver iterations per step.
      new: the same.
      drift: largest difference of qpos, qvel, act one step after the same states, in SI units;
        None where the sides have different models.
      nbatch: simulations of a block.
      nstep: steps of each.
    """

    old: Mapping[str, float]
    new: Mapping[str, float]
    drift: float | None
    nbatch: int
    nstep: int


# -- processes ----------------------------------------------------------------------------------


class Process:
    """A worker, seen from here."""

    def __init__(self, connection: Connection, name: str, limit_s: float, pid: int, ended: Any):
        self.connection, self.name, self.limit_s, self.pid = connection, name, limit_s, pid
        self._ended = ended  # waits for the end of the process; returns its exit code
        self._code: int | None = None
        self.doing = "starting"

    def call(self, do: str, **arguments: Any) -> Any:
        """Ask for something and wait for the answer.

        Raises:
          InputError: what was asked for cannot be.
          SideError: it failed, crashed or did not answer in time.
        """
        self.ask(do, **arguments)
        return self.answer()

    def ask(self, do: str, **arguments: Any) -> None:
        """Ask for something; `answer` waits for it."""
        self.doing = _DOING.get(do, do)
        with contextlib.suppress(OSError):  # a dead worker is told by `answer`
            self.connection.send((do, arguments))

    def answer(self) -> Any:
        """Wait for the answer to what was asked."""
        status, value = self._receive(self.connection.recv)
        if status == "ok":
            return value
        kind = InputError if status == "input" else SideError
        raise kind(f"{self.name}: {value}")

    def block(self) -> int:
        """Have one block run; return its nanoseconds."""
        with contextlib.suppress(OSError):
            self.connection.send_bytes(worker.BLOCK)
        content = self._receive(self.connection.recv_bytes)
        ns = int(worker.NANOSECONDS.unpack(content)[0]) if len(content) == 8 else 0
        if ns <= 0:
            raise SideError(f"{self.name}: says that a block took {ns} ns")
        return ns

    def fork(self) -> "Process":
        """Return a new process with all that this one knows."""
        ours, theirs = worker.pair()
        with theirs:
            self.doing = "forking"
            with contextlib.suppress(OSError):  # a dead worker is told by `answer`
                self.connection.send(("fork", {}))
                send_handle(self.connection, theirs.fileno(), self.pid)
            pid = self.answer()
        return Process(ours, self.name, self.limit_s, pid, lambda: self.call("ended", pid=pid))

    def end(self) -> None:
        """Have the process end, whatever it is doing, and its parent take note."""
        self.connection.close()
        if self._code is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
        with contextlib.suppress(SideError, InputError, OSError):
            self._exit_code()

    def _exit_code(self) -> int:
        if self._code is None:
            self._code = int(self._ended())
        return self._code

    def _receive(self, receive: Callable[[], Any]) -> Any:
        if not self.connection.poll(self.limit_s):
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
            raise SideError(f"{self.name}: no answer within {self.limit_s:g} s while {self.doing}")
        try:
            return receive()
        except (EOFError, OSError):
            how = isolate.cause_of_death(self._exit_code())
            raise SideError(f"{self.name}: {how} while {self.doing}") from None


_DOING = {
    "start": "importing MuJoCo",
    "load": "loading the model",
    "make": "making the workload",
    "take": "taking the workload",
    "observe": "stepping the model",
    "prepare": "preparing a run",
    "time": "running a block",
}


class Fleet:
    """Warm processes of all releases of a command, kept until it is left."""

    def __init__(self, limit_s: float = 60.0, count: int = WARM):
        self.limit_s, self.count = limit_s, count
        self._closing = contextlib.ExitStack()
        self._warm: dict[tuple[str, int], Process] = {}
        self._waiting: dict[tuple[str, int], Process] = {}
        self._folders: dict[str, Path | None] = {}

    def __enter__(self) -> "Fleet":
        with contextlib.ExitStack() as closing:
            folder = Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="mjbench-")))
            # alone in its folder: whatever else is beside mjbench must not be found by a release
            (folder / "mjbench").symlink_to(Path(mjbench.__file__).resolve().parent)
            self._core = folder
            (folder / "work").mkdir()
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def start(self, release: installs.Wanted, number: int = 0) -> None:
        """Begin to start a warm process, without waiting for it."""
        key = (release.key, number)
        if key not in self._warm and key not in self._waiting:
            self._waiting[key] = self._start(release)

    def warm(self, release: installs.Wanted, number: int = 0) -> Process:
        """Return a warm process of a release."""
        key = (release.key, number)
        self.start(release, number)
        if key in self._waiting:
            process = self._waiting.pop(key)
            process.answer()
            self._warm[key] = process
        return self._warm[key]

    def _start(self, release: installs.Wanted) -> Process:
        if release.key not in self._folders:
            folder = self._closing.enter_context(installs.use(release))
            self._folders[release.key] = folder
        ours, theirs = worker.pair()
        with theirs:
            theirs.set_inheritable(True)
            said = (self._core / "work" / "said.txt").open("ab")
            self._closing.callback(said.close)
            child = subprocess.Popen(
                worker.command(
                    f"from mjbench.worker import main; main({theirs.fileno()})",
                    self._core,
                    self._folders[release.key],
                ),
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                cwd=self._core / "work",
                env=worker.environment(self._folders[release.key]),
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._closing.callback(_kill, child, ours)
        name = f"MuJoCo {release.version}"
        process = Process(ours, name, self.limit_s, child.pid, child.wait)
        process.ask("start", version=release.version)
        return process


def _kill(child: "subprocess.Popen[bytes]", connection: Connection) -> None:
    connection.close()
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


# -- measuring ----------------------------------------------------------------------------------


class Pair:
    """Two sides, ready to be launched as often as it takes."""

    def __init__(self, fleet: Fleet, old: Side, new: Side, sizes: Sizes = Sizes()):
        """Load the models, and make sure that both sides can do the same work.

        Raises:
          InputError: a side cannot do it.
          SideError: a side crashed, hung or failed.
        """
        self.fleet, self.sides, self.sizes = fleet, (old, new), sizes
        self._holders: dict[tuple[int, int], Process] = {}
        try:
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        old, new = self.sides
        sizes = self.sizes
        # all of them before anything is timed: one that starts meanwhile would be in the way
        numbers = range(self.fleet.count)
        for number, i in itertools.product(numbers, (0, 1)):
            self.fleet.start(self.sides[i].release, self._number(i, number))
        for number, i in itertools.product(numbers, (0, 1)):
            self.fleet.warm(self.sides[i].release, self._number(i, number))
        first, second = self._loaded(0, 0), self._loaded(1, 0)
        nbatch, nstep = self._sizes(first.call("cost"), second.call("cost"))
        making = {"nbatch": nbatch, "nstep": nstep, "hold": sizes.hold, "seed": sizes.seed}
        self._given = self._made(first, making)
        self._own: dict[str, Any] | None = None
        first.call("take", **self._given)
        try:
            second.call("take", **self._given)
        except InputError:
            if old.model == new.model:
                raise
            self._own = self._made(second, making)  # another model: starts of its own
            second.call("take", **self._own)
        first.ask("observe")
        second.ask("observe")
        self._seen = (first.answer(), second.answer())
        self.same = self._compared(nstep)

    def launch(self, number: int) -> Launch:
        """Measure once, in fresh processes."""
        warm = number % self.fleet.count
        parallel = any(side.parallel for side in self.sides)
        core = None if parallel else freest_core()
        order = random.sample((0, 1), 2)
        processes: dict[int, Process] = {}
        with contextlib.ExitStack() as ending:
            for i in order:
                processes[i] = self._holder(i, warm).fork()
                ending.callback(processes[i].end)
            cores = self._cores(warm) if parallel else None
            with _pinned(core):
                warm_ns = [self._prepare(processes[i], i, core) for i in order]
                quads = int(1e9 * LAUNCH_S / (2 * sum(warm_ns)))
                quads = min(max(quads, LEAST_QUADS), MOST_QUADS)
                orders, ns = _quads(processes[0], processes[1], quads)
        return Launch(warm, core, cores, orders, ns)

    def close(self) -> None:
        """End the processes that hold the models."""
        for holder in self._holders.values():
            holder.end()
        self._holders.clear()

    @staticmethod
    def _made(holder: Process, making: Mapping[str, Any]) -> dict[str, Any]:
        """Return a workload by field, made by a process of its own.

        Were it made by one of the two sides, their memory would differ.
        """
        maker = holder.fork()
        try:
            maker.call("make", **making)
            return dict(maker.call("give"))
        finally:
            maker.end()

    def _prepare(self, process: Process, i: int, core: int | None) -> int:
        side, seen = self.sides[i], self._seen[i]
        return int(
            process.call(
                "prepare",
                path=side.path,
                options=dict(side.options),
                cores=None if core is None else [core],
                extra=round(side.slowdown * len(seen["final"])),
                final=seen["final"],
            )
        )

    def _loaded(self, i: int, warm: int) -> Process:
        side = self.sides[i]
        holder = self.fleet.warm(side.release, self._number(i, warm)).fork()
        self._holders[i, warm] = holder
        holder.name = f"{('old', 'new')[i]} side (MuJoCo {side.release.version}, {side.model.name})"
        holder.call(
            "load",
            name=side.model.name,
            path=str(side.model.path),
            options=dict(side.model_options),
        )
        return holder

    @staticmethod
    def _number(i: int, warm: int) -> int:
        """Return the number of a side's warm process: never the other side's, nor of one release.

        Two releases cannot share a process; two sides of one release must not, or comparing it
        with itself would tell nothing of comparing two.
        """
        return 2 * warm + i

    def _holder(self, i: int, warm: int) -> Process:
        if (i, warm) not in self._holders:
            holder = self._loaded(i, warm)
            holder.call("take", **(self._given if i == 0 or self._own is None else self._own))
        return self._holders[i, warm]

    def _sizes(self, *step_s: float) -> tuple[int, int]:
        """Return simulations and steps of each, so that a block takes about BLOCK_S."""
        hold = self.sizes.hold
        threads = max(
            (side.options.get(name) or 1 for side in self.sides for name in _THREAD_OPTIONS),
            default=1,
        )
        block_s = BLOCK_S if threads == 1 else threads * THREADED_BLOCK_S
        steps = max(1, int(block_s / max(step_s)))
        if self.sizes.nbatch:
            nbatch = self.sizes.nbatch
            return nbatch, self.sizes.nstep or hold * max(1, steps // nbatch // hold)
        nstep = self.sizes.nstep or hold * max(1, min(steps, MOST_NSTEP) // hold)
        return max(1 if threads == 1 else 4 * threads, steps // nstep), nstep

    def _compared(self, nstep: int) -> Same:
        old, new = self._seen
        for side, seen in zip(self.sides, self._seen, strict=True):
            if seen["diverged"]:
                raise InputError(
                    f"{side.model.name} with MuJoCo {side.release.version}: {seen['diverged']} of"
                    f" {len(seen['final'])} simulations diverge ({seen['diagnosis']})"
                )
        if len(old["final"]) != len(new["final"]):
            raise InputError(
                f"the sides have {len(old['final'])} and {len(new['final'])} simulations that do"
                " not diverge: not the same work"
            )
        same_sizes = all(old["after"][k].shape == new["after"][k].shape for k in old["after"])
        drift = (
            agreement.drift(new["after"], old["after"]) if same_sizes and not self._own else None
        )
        return Same(old["work"], new["work"], drift, len(old["final"]), nstep)

    def _cores(self, warm: int) -> float:
        threads = min(
            machine.usable_cores(),
            max(s.options.get(name) or 1 for s in self.sides for name in _THREAD_OPTIONS),
        )
        if threads == 1:
            return 1.0
        process = self._holder(0, warm).fork()  # neither side's: it allocates and starts threads
        try:
            return float(process.call("cores", threads=threads))
        finally:
            process.end()


def _quads(old: Process, new: Process, count: int) -> tuple[list[str], np.ndarray]:
    """Time `count` quads; return their orders and (count, 4) nanoseconds."""
    sides = {"A": old, "B": new}
    for side in sides.values():
        side.ask("time")
    orders = [random.choice(("ABBA", "BAAB")) for _ in range(count)]
    ns = np.array([[sides[letter].block() for letter in order] for order in orders])
    for side in sides.values():
        with contextlib.suppress(OSError):
            side.connection.send_bytes(worker.END)
        side.answer()
    return orders, ns


def freest_core(seconds: float = 0.002) -> int | None:
    """Return the core, of those this process may use, that others leave most of; None if unknown.

    It is the one on which a busy loop got the largest share of the time.
    """
    if not hasattr(os, "sched_setaffinity"):
        return None
    allowed = sorted(os.sched_getaffinity(0))
    shares: dict[int, float] = {}
    for core in random.sample(allowed, min(len(allowed), 8)):
        with _pinned(core):
            begin, used = time.perf_counter(), time.thread_time()
            while time.perf_counter() - begin < seconds:
                pass
            shares[core] = (time.thread_time() - used) / (time.perf_counter() - begin)
    best = max(shares.values())
    return random.choice([core for core, share in shares.items() if share > best - 0.02])


@contextlib.contextmanager
def _pinned(core: int | None) -> Iterator[None]:
    """Keep this process on one core while the block runs."""
    if core is None:
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, [core])
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
