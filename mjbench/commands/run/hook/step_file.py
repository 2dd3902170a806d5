"""The file into which the step clock of a process writes; `run/step_times.py` reads it."""

import functools
import itertools
import mmap
import os
import struct
import sys
from _thread import get_ident
from collections.abc import Sequence

# A record: kind, thread, begin and end in ns, steps, timestep in ns.
RECORD = struct.Struct("<6q")
# What stands before the records, as `Header` names it: what the step clock writes, and then what
# the clock of garbage collections does.
OF_STEPS, OF_COLLECTIONS = struct.Struct("<7q"), struct.Struct("<3q")
HEADER = struct.Struct("<10q")
# Seconds by the engine's timers, as sums over bursts.
MAX_TIMERS = 32
TIMERS = struct.Struct(f"<{MAX_TIMERS}d")
FIRST_RECORD = HEADER.size + TIMERS.size
CAPACITY = 1 << 17  # records of a process: 6 MB
_SIZE = FIRST_RECORD + CAPACITY * RECORD.size

# Kinds of records.
STEP, ITERATION, BURST = 1, 2, 3
# Of a thread's identifier, so that it fits a record.
_THREAD_BITS = 2**63 - 1


def map_file(path: str, size: int) -> mmap.mmap:
    """Return the memory of a new file of zeros, which survives any end of the program.

    The file has all its space on the disk: without that, to write to the memory, or to read it,
    would end the process. Where there is no space, the file is empty.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        _allocate(descriptor, size)
        return mmap.mmap(descriptor, size)
    except BaseException:
        os.ftruncate(descriptor, 0)
        raise
    finally:
        os.close(descriptor)


def path_of(folder: str) -> str:
    """Return the path of the file of this process."""
    return os.path.join(folder, f"{os.getpid()}.steps")


def _allocate(descriptor: int, size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
    else:
        while size > 0:
            size -= os.write(descriptor, bytes(size))


class StepFile:
    """The file of one process; memory alone where its folder is `os.devnull`."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self.open()

    def open(self) -> None:
        if self._folder == os.devnull:
            self._begin(mmap.mmap(-1, _SIZE))
        else:
            self._begin(map_file(path_of(self._folder), _SIZE))

    def close(self) -> None:
        self._begin(mmap.mmap(-1, FIRST_RECORD))
        self._next = itertools.repeat(CAPACITY).__next__

    def _begin(self, memory: mmap.mmap) -> None:
        self._map = memory
        self._next = itertools.count().__next__
        self._timers = [0.0] * MAX_TIMERS
        # a function of C, as `CollectionClock` needs it
        self.write_collections = functools.partial(OF_COLLECTIONS.pack_into, memory, OF_STEPS.size)

    def write(self, kind: int, begin_ns: int, end_ns: int, nstep: int, timestep_ns: int) -> int:
        """Write a record; return how many there are now."""
        slot = self._next()
        if slot < CAPACITY:
            RECORD.pack_into(
                self._map,
                FIRST_RECORD + slot * RECORD.size,
                kind,
                get_ident() & _THREAD_BITS,
                begin_ns,
                end_ns,
                nstep,
                timestep_ns,
            )
        return slot + 1

    def write_header(self, *values: int) -> None:
        """Write the first values of `step_times.Header`, those of the step clock."""
        OF_STEPS.pack_into(self._map, 0, *values)

    def add_timers(self, seconds: Sequence[float]) -> None:
        for i, value in enumerate(seconds[:MAX_TIMERS]):
            self._timers[i] += value
        TIMERS.pack_into(self._map, HEADER.size, *self._timers)

    def calls_to_pass(self, used: int, burst: int) -> int:
        """Return how many calls must have no record until the next burst.

        The fuller the file, the more they are: it never overflows.
        """
        if used > CAPACITY - 2 * burst:
            return sys.maxsize
        return burst * used // (CAPACITY - 2 * burst - used or 1) if used > CAPACITY // 2 else 0
