"""The profiler beside a program, and what it costs."""

import contextlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.commands.run import py_spy, thread_pools
from mjbench.commands.run.gil_waits import Holders, ThreadTimes
from mjbench.commands.run.py_spy import ThreadSamples
from mjbench.commands.run.thread_pools import MappedLibraries, ThreadPools
from mjbench.errors import InputError
from mjbench.host import machine

# Looks from one list of the program's processes to the next: to list them takes longer than a look.
LOOKS_PER_LIST = 30
# Seconds for which the holders of the GIL are sampled, if a process has several busy threads.
HOLDERS_S, HOLDERS_RATE_HZ = 3.0, 100


@dataclass(frozen=True)
class ProcessorUse:
    """Processor time while a program ran, in seconds per second.

    Attributes:
      program_cores: of the program and of its child processes that have ended.
      observer_cores: of the profiler and of mjbench.
      usable_cores: that all of them may use.
    """

    program_cores: NonNegativeFloat
    observer_cores: NonNegativeFloat
    usable_cores: NonNegativeInt

    @property
    def displaced_share(self) -> float:
        """By how much observing lengthens the program since it takes processor time, estimated.

        Observing takes nothing from the program where a core is free, and all of its time where
        none is.
        """
        free = min(1.0, max(0.0, self.usable_cores - self.program_cores))
        busy = self.observer_cores / self.program_cores if self.program_cores > 0 else 0.0
        return (1.0 - free) * busy


@dataclass(frozen=True)
class ProcessorClock:
    """Processor seconds at one moment."""

    time_s: float
    own_s: float
    children_s: float

    @classmethod
    def now(cls) -> "ProcessorClock":
        times = os.times()
        children_s = times.children_user + times.children_system  # zero on Windows
        return cls(time.monotonic(), times.user + times.system, children_s)

    def use(self, begin: "ProcessorClock", profiling: "Profiling") -> ProcessorUse | None:
        """Return what was used since `begin`, if known; the last profiler must still run."""
        wall_s = self.time_s - begin.time_s
        program_s = self.children_s - begin.children_s - profiling.earlier_cpu_s
        if program_s <= 0 or wall_s <= 0:
            return None
        observer_s = self.own_s - begin.own_s + profiling.cpu_s
        return ProcessorUse(program_s / wall_s, observer_s / wall_s, machine.usable_cores())


@dataclass
class Profiling:
    """The profiler beside a program; it starts again at a lower rate if there are many processes.

    Attributes:
      asked_rate_hz: that the user asks for; None for the usual.
      begin_s: when the profiler began to take samples, on the clock of `time.monotonic`.
      holding: the profiler of threads that hold the GIL, if a process has several busy threads.
    """

    pid: int
    folder: Path
    rate_hz: int
    asked_rate_hz: int | None
    sampler: py_spy.Sampler
    children: Sequence[int] = ()
    looks_listed: int = 0
    begin_s: float | None = None
    earlier: Sequence[ThreadSamples] = ()
    has_many_children: bool = False
    earlier_cpu_s: float = 0.0
    problem: str = ""
    thread_times: ThreadTimes = field(default_factory=ThreadTimes)
    libraries: MappedLibraries = field(default_factory=MappedLibraries)
    holding: "_Holding | None" = None

    @classmethod
    def begin(cls, pid: int, folder: Path, rate_hz: int | None) -> "Profiling":
        """Start the profiler, at the usual rate without one."""
        rate = rate_hz or py_spy.DEFAULT_RATE_HZ
        return cls(pid, folder, rate, rate_hz, py_spy.start(pid, folder, rate))

    def look(self) -> None:
        """See whether the profiler has begun, and whether there are many processes by now."""
        if self.looks_listed % LOOKS_PER_LIST == 0:
            # the processes whose step clock has begun, but the first
            pids = {int(file.stem) for file in self.folder.glob("*.steps")}
            self.children = sorted(pids - {self.pid})
            self.thread_times.look((self.pid, *self.children))
            self.libraries.look(self.children)
            self._look_for_holders()
        self.looks_listed += 1
        if self.begin_s is None and self.sampler.has_begun:
            self.begin_s = time.monotonic()
        if self.has_many_children or self.begin_s is None or not self.sampler.is_running:
            return
        self.has_many_children = len(self.children) >= py_spy.MANY_CHILDREN
        if self.has_many_children:
            rate = self.asked_rate_hz or min(self.rate_hz, py_spy.MANY_RATE_HZ)
            if rate != self.rate_hz:
                self._restart(rate)

    def _look_for_holders(self) -> None:
        """Sample the holders of the GIL for a while, once a process has several busy threads."""
        if self.holding is not None:
            self.earlier_cpu_s += self.holding.look()
        elif self.begin_s is not None and (pid := self.thread_times.contending()) is not None:
            beside = py_spy.start(pid, self.folder, HOLDERS_RATE_HZ, HOLDERS_S)
            self.holding = _Holding(pid, beside)

    def crowded(self, seen: Sequence[ThreadSamples]) -> ThreadPools | None:
        of_python = {(each.thread.pid, each.thread.tid) for each in seen}
        times, cores = self.thread_times.times(), machine.usable_cores()
        return thread_pools.crowded(times, of_python, self.libraries.variables, cores)

    def holders(self) -> Holders | None:
        return None if self.holding is None else self.holding.holders()

    def _restart(self, rate_hz: int) -> None:
        """Start the profiler again; what it has seen is not lost."""
        end_s = time.monotonic()
        self.earlier_cpu_s = self.cpu_s
        self.sampler.stop()
        self.earlier = [*self.earlier, *self._read(end_s)]
        self.begin_s = None
        self.rate_hz = rate_hz
        self.sampler = py_spy.start(self.pid, self.folder, rate_hz)

    @property
    def cpu_s(self) -> float:
        return self.earlier_cpu_s + self.sampler.cpu_s()

    def samples(self, end_s: float) -> tuple[Sequence[ThreadSamples], str]:
        seen = [*self.earlier, *self._read(end_s)]
        return seen, "" if seen else self.problem or self.sampler.problem()

    def _read(self, end_s: float) -> Sequence[ThreadSamples]:
        file = self.sampler.file
        if not file.is_file():
            return []
        try:
            seen = py_spy.read(file)
        except InputError as error:  # the disk is full, or it was killed
            self.problem = str(error)
            return []
        file.unlink()
        return seen if self.begin_s is None else py_spy.spread_over(seen, end_s - self.begin_s)


@dataclass
class _Holding:
    pid: int
    sampler: py_spy.Sampler
    begin_s: float = field(default_factory=time.monotonic)
    cpu_s: float = 0.0

    def look(self) -> float:
        earlier_s, self.cpu_s = self.cpu_s, max(self.cpu_s, self.sampler.cpu_s())
        return self.cpu_s - earlier_s

    def holders(self) -> Holders | None:
        seconds = min(HOLDERS_S, time.monotonic() - self.begin_s)
        self.sampler.stop()
        with contextlib.suppress(InputError):
            seen = py_spy.read(self.sampler.file)
            of_process = [each for each in seen if each.thread.pid == self.pid]
            return Holders(self.pid, of_process, round(seconds * HOLDERS_RATE_HZ))
        return None
