"""Two sides, alternated block by block in fresh processes: the engine of every comparison.

A launch is a process of each side with memory laid out anew. Both sit on one core, with this
process, and take turns in quads, ABBA or BAAB at random, so that drift and the order of turns hit
both alike. A launch gives one number, the middle of its quads' log ratios; launches are the
samples of which stats makes a verdict, and as many are made as the verdict needs.

This module runs on NumPy alone; only a verdict (stats) needs SciPy.
"""

import contextlib
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


# The cores that this process may use, before it pins itself to one.
_ALLOWED = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


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
      core: that both sides ran on; None where they may use all.
      cores: that as many threads as the sides have got just before; None for one thread.
      orders: of each quad, `ABBA` or `BAAB`; A is the old side.
      ns: (quads, 4) nanoseconds of each block, in the order they ran.
    """

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
    """Starts processes in the environment of any release; ends all of them when it is left."""

    def __init__(self, limit_s: float = 60.0):
        self.limit_s = limit_s
        self._closing = contextlib.ExitStack()
        self._started: list[tuple[subprocess.Popen[bytes], Connection]] = []
        self._folders: dict[str, Path | None] = {}

    def __enter__(self) -> "Fleet":
        with contextlib.ExitStack() as closing:
            folder = Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="mjbench-")))
            # alone in its folder: whatever else is beside mjbench must not be found by a release
            (folder / "mjbench").symlink_to(Path(mjbench.__file__).resolve().parent)
            self._core = folder
            (folder / "work").mkdir()
            closing.callback(self._end_all)
            self._closing = closing.pop_all()
        return self

    def _end_all(self) -> None:
        for child, connection in self._started:
            _kill(child, connection)

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def scratch(self) -> Path:
        """Return a folder that lasts as long as this fleet."""
        return self._core / "work"

    def start(self, release: installs.Wanted) -> Process:
        """Begin to start a process that imports a release; its first answer says that it did."""
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
        alive = [(c, o) for c, o in self._started if c.poll() is None]
        self._started[:] = [*alive, (child, ours)]
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
        self._files: dict[int, str] = {}
        self._next: list[Process] = []
        try:
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        sizes = self.sizes
        self._ahead()
        both = self._taken()
        try:
            for i, (process, side) in enumerate(zip(both, self.sides, strict=True)):
                process.call(
                    "load",
                    name=side.model.name,
                    path=str(side.model.path),
                    options=dict(side.model_options),
                )
                file = tempfile.mkstemp(suffix=".mjb", dir=self.fleet.scratch())[1]
                process.call("save", path=file)
                self._files[i] = file
            nbatch, nstep = self._sizes(*(process.call("cost") for process in both))
            making = {"nbatch": nbatch, "nstep": nstep, "hold": sizes.hold, "seed": sizes.seed}
            given = self._made(both[0], making)
            self._given = [given, given]
            both[0].call("take", **given)
            try:
                both[1].call("take", **given)
            except InputError:
                if self.sides[0].model == self.sides[1].model:
                    raise
                self._given[1] = self._made(both[1], making)  # another model: starts of its own
                both[1].call("take", **self._given[1])
            for process in both:
                process.ask("observe")
            self._seen = tuple(process.answer() for process in both)
        finally:
            for process in both:
                process.end()
        self.same = self._compared(nstep)

    def launch(self) -> Launch:
        """Measure once, in fresh processes."""
        parallel = any(side.parallel for side in self.sides)
        cores = self._cores() if parallel else None
        with contextlib.ExitStack() as ending:
            both = self._taken()
            for process in both:
                ending.callback(process.end)
            order = random.sample((0, 1), 2)
            for i in order:
                self._equip(both[i], i)
            if parallel:  # all cores are the sides': what starts meanwhile would be in the way
                for process in self._next:
                    process.connection.poll(process.limit_s)
            core = None if parallel else freest_core()
            with _pinned(core), self._elsewhere(core):
                warm_ns = [self._prepare(both[i], i, core) for i in order]
                quads = int(1e9 * LAUNCH_S / (2 * sum(warm_ns)))
                quads = min(max(quads, LEAST_QUADS), MOST_QUADS)
                orders, ns = _quads(both[0], both[1], quads)
        return Launch(core, cores, orders, ns)

    def close(self) -> None:
        """End the processes that were started ahead."""
        for process in self._next:
            process.end()
        self._next = []

    def _ahead(self) -> None:
        """Start the processes of the next launch, without waiting for them."""
        made: dict[int, Process] = {}
        for i in random.sample((0, 1), 2):  # in whatever order, so that none is always the first
            side = self.sides[i]
            made[i] = self.fleet.start(side.release)
            word = ("old", "new")[i]
            made[i].name = f"{word} side (MuJoCo {side.release.version}, {side.model.name})"
            self._next = list(made.values())
        self._next = [made[0], made[1]]

    def _taken(self) -> list[Process]:
        """Return the processes started ahead, and start the next."""
        both, self._next = self._next, []
        try:
            for process in both:
                process.answer()
            self._ahead()
        except BaseException:
            for process in both:
                process.end()
            raise
        return both

    @contextlib.contextmanager
    def _elsewhere(self, core: int | None) -> Iterator[None]:
        """Keep the processes of the next launch off a core while the block runs."""
        if core is None:
            yield
            return
        others = _ALLOWED - {core}
        _place(self._next, others or _ALLOWED)
        try:
            yield
        finally:
            _place(self._next, _ALLOWED)

    def _equip(self, process: Process, i: int) -> None:
        """Load the saved model and the workload."""
        process.call("load", name=self.sides[i].model.name, path=self._files[i], options={})
        process.call("take", **self._given[i])

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
                cores=sorted(_ALLOWED) if core is None else [core],
                extra=round(side.slowdown * len(seen["final"])),
                final=seen["final"],
            )
        )

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
        shared = self._given[0] is self._given[1]
        same_sizes = all(old["after"][k].shape == new["after"][k].shape for k in old["after"])
        drift = agreement.drift(new["after"], old["after"]) if same_sizes and shared else None
        return Same(old["work"], new["work"], drift, len(old["final"]), nstep)

    def _cores(self) -> float:
        threads = min(
            machine.usable_cores(),
            max(s.options.get(name) or 1 for s in self.sides for name in _THREAD_OPTIONS),
        )
        if threads == 1:
            return 1.0
        # neither side's process: calibrating allocates, and starts threads
        process = self.fleet.start(self.sides[0].release)
        try:
            process.answer()
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


def _place(processes: Sequence[Process], cores: set[int]) -> None:
    for process in processes:
        with contextlib.suppress(OSError):  # it may have ended; `answer` tells
            os.sched_setaffinity(process.pid, cores)


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
