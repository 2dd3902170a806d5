"""The stacks that the sampling profiler saw.

The profiler is py-spy: a program of its own, which reads the stacks of another from outside. It
writes the file format of speedscope (https://www.speedscope.app/file-format-schema.json).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from mjbench.errors import InputError

# How source files of libraries end.
_COMPILED = (".c", ".cc", ".cpp", ".cxx", ".h", ".hpp", ".pyx", ".rs", ".S")


@dataclass(frozen=True)
class Frame:
    """One frame of a stack; lines count from 1, and a library has line 0."""

    function: str
    file: str
    line: int

    @property
    def is_python(self) -> bool:
        """Whether it is a line of Python; libraries with debugging information have lines, too."""
        return self.line > 0 and not self.file.endswith(_COMPILED)


@dataclass(frozen=True)
class Thread:
    """A thread of one process."""

    pid: int
    tid: int
    name: str


@dataclass(frozen=True)
class ThreadSamples:
    """The stacks of one thread, each outermost frame first."""

    thread: Thread
    stacks: Sequence[Sequence[Frame]]
    interval_s: float
    has_native: bool = True


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
# Frames that stand for a process or a thread.
_LABEL = re.compile(r"(process|thread) \(?\d+")


def read(file: Path) -> list[ThreadSamples]:
    try:
        stored = msgspec.json.decode(file.read_bytes(), type=_File)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the profiler's samples: {error}") from error
    frames = [
        None
        if _LABEL.match(frame.name) and not frame.file
        else Frame(frame.name, frame.file or "", frame.line or 0)
        for frame in stored.shared.frames
    ]
    has_native = any(frame is not None and not frame.is_python for frame in frames)
    threads = [_thread_samples(profile, frames) for profile in stored.profiles]
    return [replace(thread, has_native=has_native) for thread in threads]


def spread_over(threads: Sequence[ThreadSamples], seconds: float) -> list[ThreadSamples]:
    """Return samples whose intervals add up to the time in which they were taken.

    The profiler draws its intervals at random, so their number differs from time to time. At each
    it samples all threads; the one that has most samples was there from the begin to the end.
    """
    most = max((len(thread.stacks) for thread in threads), default=0)
    return [replace(thread, interval_s=seconds / most) for thread in threads] if most else []


def _thread_samples(profile: _Profile, frames: Sequence[Frame | None]) -> ThreadSamples:
    match = _THREAD.match(profile.name)
    if match is None:
        raise InputError(f"the profiler names a thread {profile.name!r}, which is not understood")
    thread = Thread(int(match[1]), int(match[2]), match[3] or "")
    stacks = [
        [frame for i in indices if (frame := frames[i]) is not None] for indices in profile.samples
    ]
    return ThreadSamples(thread, stacks, profile.weights[0] if profile.weights else 0.0)
