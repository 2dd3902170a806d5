"""py-spy, the sampling profiler: a program of its own that reads the stacks of another.

It writes the file format of speedscope (https://www.speedscope.app/file-format-schema.json).
"""

import contextlib
import math
import os
import re
import shutil
import signal
import subprocess
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from mjbench import extras
from mjbench.errors import InputError, UnavailableError, one_line
from mjbench.host import child

# Samples per second.
DEFAULT_RATE_HZ = 100
# From so many child processes on, samples are fewer: the program needs the profiler's core.
MANY_CHILDREN, MANY_RATE_HZ = 2, 20
# Seconds in which the profiler notices that the program has ended.
ENDING_S = 2.0
# Seconds that the profiler may take to write its file, once the program has ended.
WRITING_S = 60.0
# Seconds for both, where the user waits for the end.
HURRIED_S = 0.25
# Why there are no samples of a program that is over before the profiler has read it.
TOO_SHORT = "it ended before it could be sampled, or it is no program of Python"
# Why the profiler is not allowed to read a process, and what helps.
_REFUSED = ("permission", "operation not permitted", "access denied", "requires root")


@dataclass
class Sampler:
    """A profiler that samples a process."""

    process: subprocess.Popen[bytes]
    file: Path
    log: Path

    @property
    def is_running(self) -> bool:
        return self.process.poll() is None

    @property
    def has_begun(self) -> bool:
        """Whether the profiler takes samples: it says so first."""
        return self.log.stat().st_size > 0

    def cpu_s(self) -> float:
        import psutil

        with contextlib.suppress(psutil.Error):
            times = psutil.Process(self.process.pid).cpu_times()
            return float(times.user + times.system)
        return 0.0

    def stop(self, writing_s: float = WRITING_S) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(writing_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def finish(self, is_hurried: bool = False) -> None:
        """Wait until the profiler has written its file; stop one that outlives the program."""
        try:
            self.process.wait(HURRIED_S if is_hurried else ENDING_S)
        except subprocess.TimeoutExpired:
            self.stop(HURRIED_S if is_hurried else WRITING_S)

    def problem(self) -> str:
        text = self.log.read_text(encoding="utf-8", errors="replace")
        if not any(word in text.lower() for word in _REFUSED):
            return TOO_SHORT
        lines = [line for line in text.splitlines() if line.startswith(("Error:", "Reason:"))]
        return one_line(" ".join(lines) or "not permitted", 200) + (
            "; a container needs the capability SYS_PTRACE (docker run --cap-add SYS_PTRACE),"
            " elsewhere kernel.yama.ptrace_scope must be 0 or 1"
        )


def program() -> str:
    """Return the path of the profiler; UnavailableError without one."""
    beside = Path(sysconfig.get_path("scripts")) / ("py-spy.exe" if os.name == "nt" else "py-spy")
    path = str(beside) if beside.is_file() else shutil.which("py-spy")
    if path is None:
        raise UnavailableError(
            f"py-spy is not installed; install it with {extras.install_command()}"
        )
    return path


def start(pid: int, folder: Path, rate_hz: int, holders_s: float | None = None) -> Sampler:
    """Sample a process and those that it starts, until it ends or `Sampler.stop`.

    Args:
      holders_s: seconds for which only threads that hold the GIL are sampled; None for all threads.
    """
    name = "sampler" if holders_s is None else "holders"
    file, log = folder / f"{name}.json", folder / f"{name}.log"
    command = [program(), "record", "--pid", str(pid), "--rate", str(rate_hz)]
    command += ["--format", "speedscope", "--output", str(file)]
    command += ["--threads", "--full-filenames", "--subprocesses", "--nonblocking"]
    if holders_s is None:
        command.append("--idle")
    else:
        command += ["--gil", "--duration", str(math.ceil(holders_s) + 1)]
    with log.open("wb") as output:
        # in a session of its own: Ctrl-C is for the program
        process = subprocess.Popen(
            child.ending_with_parent(command),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
    return Sampler(process, file, log)


# -- the stacks that it saw ------------------------------------------------------------------------


@dataclass(frozen=True)
class Frame:
    """One frame of a stack; lines count from 1."""

    function: str
    file: str
    line: int


@dataclass(frozen=True)
class Thread:
    """A thread of one process."""

    pid: int
    tid: int
    name: str


@dataclass(frozen=True)
class ThreadSamples:
    """The stacks of one thread, each outermost frame first.

    Attributes:
      interval_s: for which each stands.
      least_s: for which each stands at least: a profiler that falls behind misses some unevenly.
    """

    thread: Thread
    stacks: Sequence[Sequence[Frame]]
    interval_s: float
    least_s: float = math.inf


class _File(msgspec.Struct):
    profiles: list["_Profile"]
    shared: "_Shared"


class _Profile(msgspec.Struct):
    name: str
    samples: list[list[int]]
    weights: list[float]


class _Shared(msgspec.Struct):
    frames: list["_Frame"]


class _Frame(msgspec.Struct):
    name: str
    file: str | None = None
    line: int | None = None


# What py-spy names a thread's samples.
_THREAD = re.compile(r'Process (\d+) Thread (\d+)(?: "(.*)")?$', flags=re.DOTALL)


def read(file: Path) -> list[ThreadSamples]:
    try:
        stored = msgspec.json.decode(file.read_bytes(), type=_File)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the profiler's samples: {error}") from error
    # what has no line stands for a process or a thread, and a name that py-spy read while it
    # changed may hold a null byte
    frames = [
        Frame(frame.name, (frame.file or "").replace("\0", ""), frame.line) if frame.line else None
        for frame in stored.shared.frames
    ]
    return [_thread_samples(profile, frames) for profile in stored.profiles]


def spread_over(threads: Sequence[ThreadSamples], seconds: float) -> list[ThreadSamples]:
    """Return samples whose intervals add up to the time in which they were taken.

    The profiler draws its intervals at random, so their number differs from time to time. At each
    it samples all threads; the one that has most samples was there from the begin to the end.
    """
    most = max((len(thread.stacks) for thread in threads), default=0)
    return [
        replace(thread, interval_s=seconds / most) for thread in threads if most and seconds > 0
    ]


def _thread_samples(profile: _Profile, frames: Sequence[Frame | None]) -> ThreadSamples:
    match = _THREAD.match(profile.name)
    if match is None:
        raise InputError(f"the profiler names a thread {profile.name!r}, which is not understood")
    thread = Thread(int(match[1]), int(match[2]), match[3] or "")
    stacks = [
        [frame for i in indices if (frame := frames[i]) is not None] for indices in profile.samples
    ]
    interval_s = profile.weights[0] if profile.weights else 0.0
    return ThreadSamples(thread, stacks, interval_s, interval_s)
