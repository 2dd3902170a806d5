"""The file into which the step clock of a process writes; `mjbench.program.step_times` reads it."""

import itertools
import mmap
import os
import struct
import sys
from _thread import get_ident
from collections.abc import Sequence

# A record: kind, thread, begin and end in ns, steps, timestep in ns.
RECORD = struct.Struct("<6q")
# What stands before the records, as `Header` names it.
HEADER = struct.Struct("<11q")
# Seconds by the engine's timers, as sums over bursts.
MAX_TIMERS = 32
TIMERS = struct.Struct(f"<{MAX_TIMERS}d")
FIRST_RECORD = HEADER.size + TIMERS.size
CAPACITY = 1 << 17  # records of a process: 6 MB

# Kinds of records.
STEP, ITERATION, BURST = 1, 2, 3
# Of a thread's identifier, so that it fits a record.
_THREAD_BITS = 2**63 - 1


def map_file(path: str, size: int) -> mmap.mmap:
    """Return the memory of a new file of zeros, which survives any end of the program."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        os.ftruncate(descriptor, size)
        if hasattr(os, "posix_fallocate"):
            # writing to a file without space would end the program
            os.posix_fallocate(descriptor, 0, size)
        return mmap.mmap(descriptor, 0)
    finally:
        os.close(descriptor)


class StepFile:
    """The file of one process."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self.open()

    def open(self) -> None:
        path = os.path.join(self._folder, f"{os.getpid()}.steps")
        self._map = map_file(path, FIRST_RECORD + CAPACITY * RECORD.size)
        self._next = itertools.count().__next__
        self._timers = [0.0] * MAX_TIMERS

    def close(self) -> None:
        self._map = mmap.mmap(-1, FIRST_RECORD)
        self._next = itertools.repeat(CAPACITY).__next__

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
        """Write what stands before the records, in the order of `step_times.Header`."""
        HEADER.pack_into(self._map, 0, *values)

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
