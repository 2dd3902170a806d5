"""The profiler beside a program, and what it costs: its rate follows from how long it stops it."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError
from mjbench.program import sampler, samples
from mjbench.program.samples import ThreadSamples

# Looks after which the profiler's rate is lowered if it stops the program for too long: 3 seconds.
LOOKS_TO_ADAPT, MAX_PAUSED_SHARE = 300, 0.01
# From so many child processes on, stacks of libraries are not read unless the user asks for them:
# reading them stops each process, and takes time from a core that the others need.
MANY_CHILDREN = 2
# Fewer samples per second tell too little, whatever they cost.
LEAST_RATE_HZ = 3
# The state of a process that a profiler has stopped.
_TRACED = b"t"


@dataclass(frozen=True)
class Sampling:
    """How a program is to be sampled.

    Attributes:
      rate_hz: samples per second; None for the usual, or fewer where they would cost too much.
      has_native: whether stacks of libraries are read; None where the program has few processes.
    """

    rate_hz: int | None = None
    has_native: bool | None = None


@dataclass
class Profiling:
    """The profiler beside a program, and what it costs.

    The profiler stops the program for each sample, for the longer the more threads and libraries
    the program has. Where that costs too much, it starts again at a lower rate.

    Attributes:
      pid: the program's process.
      folder: for the profiler's files.
      rate_hz: samples per second.
      has_native: whether stacks of libraries are read.
      adapts: whether the rate may be lowered.
      drops_native: whether stacks of libraries may be left out once there are many processes.
      sampler: the profiler.
      looks: how often the program was looked at.
      paused: how often the profiler had stopped it, or one of its child processes, then.
      begin_s: when the profiler began to take samples, on the clock of `time.monotonic`; None
        before that.
      earlier: samples at the first rate.
      problem: why samples could not be read; "" where they could.
    """

    pid: int
    folder: Path
    rate_hz: int
    has_native: bool
    adapts: bool
    drops_native: bool
    sampler: sampler.Sampler
    looks: int = 0
    paused: int = 0
    begin_s: float | None = None
    earlier: Sequence[ThreadSamples] = ()
    problem: str = ""

    @classmethod
    def begin(
        cls, pid: int, folder: Path, sampling: Sampling, seconds: float | None = None
    ) -> "Profiling":
        """Start the profiler; without a rate, at the usual one, which may be lowered.

        It ends with the program, or after so many seconds.
        """
        rate = sampling.rate_hz or sampler.DEFAULT_RATE_HZ
        has_native = True if sampling.has_native is None else sampling.has_native
        return cls(
            pid,
            folder,
            rate,
            has_native,
            adapts=sampling.rate_hz is None and seconds is None,
            drops_native=sampling.has_native is None and seconds is None,
            sampler=sampler.start(pid, folder, rate, has_native, seconds),
        )

    def look(self) -> None:
        """See whether the profiler has begun, and whether there are many processes by now."""
        if self.begin_s is None and self.sampler.has_begun:
            self.begin_s = time.monotonic()
        is_sampling = self.begin_s is not None and self.sampler.is_running
        if self.drops_native and is_sampling and self._has_many_children():
            self.drops_native = self.has_native = False
            self._restart(self.rate_hz)

    def _has_many_children(self) -> bool:
        return len(_children(self.folder, self.pid)) >= MANY_CHILDREN

    def look_for_pause(self) -> None:
        """See whether the profiler has stopped the program at this moment (Linux)."""
        states = [process_state(pid) for pid in (self.pid, *_children(self.folder, self.pid))]
        if states[0] is None:
            return
        self.looks += 1
        self.paused += states.count(_TRACED)
        if self.adapts and self.looks == LOOKS_TO_ADAPT:
            self._adapt()

    def _adapt(self) -> None:
        """Start again at a lower rate where the profiler costs too much."""
        self.adapts = False
        share = self.paused / self.looks
        if share > MAX_PAUSED_SHARE and self.sampler.is_running:
            self._restart(max(LEAST_RATE_HZ, round(self.rate_hz * MAX_PAUSED_SHARE / share)))

    def _restart(self, rate_hz: int) -> None:
        """Start the profiler again; what it has seen is not lost."""
        end_s = time.monotonic()
        self.sampler.stop()
        self.earlier = [*self.earlier, *self._read(end_s)]
        self.begin_s = None
        self.rate_hz = rate_hz
        self.sampler = sampler.start(self.pid, self.folder, rate_hz, self.has_native)
        self.looks = self.paused = 0

    @property
    def paused_share(self) -> float | None:
        """Share of time for which a process was stopped, summed over processes; None if unseen."""
        return self.paused / self.looks if self.looks else None

    def samples(self, end_s: float) -> tuple[Sequence[ThreadSamples], str]:
        """Return the samples until `end_s`; or why there are none."""
        seen = [*self.earlier, *self._read(end_s)]
        return seen, "" if seen else self.problem or self.sampler.problem()

    def _read(self, end_s: float) -> Sequence[ThreadSamples]:
        """Return the samples of the profiler that ran last; none where it wrote no file."""
        file = self.sampler.file
        if not file.is_file():
            return []
        try:
            seen = samples.read(file)
        except InputError as error:  # the disk is full, or it was killed
            self.problem = str(error)
            return []
        file.unlink()
        return seen if self.begin_s is None else samples.spread_over(seen, end_s - self.begin_s)


def _children(folder: Path, pid: int) -> list[int]:
    """Return the processes whose step clock has begun, but the first."""
    stems = (file.stem for file in folder.glob("*.steps"))
    return [int(stem) for stem in stems if stem != str(pid)]


def process_state(pid: int) -> bytes | None:
    """Return the letter of a process's state, as in proc(5); None where there is none to read."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:  # noqa: PTH123 - cheaper
            return file.read().rpartition(b")")[2][1:2]
    except OSError:
        return None
