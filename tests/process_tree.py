"""Which processes a test has started, so that it can see that they have ended."""

import contextlib
import os
import select
from collections.abc import Iterable
from pathlib import Path


def descendants() -> set[int]:
    """Return the process ids of everything below this process, without zombies."""
    parent_of = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, parent = file.read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parent_of[int(file.parent.name)] = int(parent)
    below: set[int] = set()
    level = {os.getpid()}
    while level:
        level = {pid for pid, parent in parent_of.items() if parent in level}
        below |= level
    return below


def opened(pids: Iterable[int]) -> list[int]:
    """Return a pidfd of each process that has not ended yet: some end as soon as they were seen."""
    descriptors = []
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            descriptors.append(os.pidfd_open(pid))
    return descriptors


def ends(process: int) -> bool:
    """Return whether the process behind a pidfd ends; the wait is only for a test that fails."""
    ready, _, _ = select.select([process], [], [], 60.0)
    os.close(process)
    return bool(ready)
