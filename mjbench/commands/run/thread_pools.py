"""Threads that libraries such as BLAS start in each of several processes: more than cores can run.

They compete for the cores, and a thread that waits for one spins. Linux says how long each thread
ran, and which libraries a process has mapped.
"""

import contextlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveFloat
from mjbench.commands.run.activities import Activity
from mjbench.commands.run.gil_waits import ThreadTime

# What a library is called in the map of a process, and what sets the number of its threads.
_VARIABLES: Mapping[Activity, Mapping[str, str]] = {
    Activity.NUMPY: {"openblas": "OPENBLAS_NUM_THREADS", "libmkl_": "MKL_NUM_THREADS"},
    Activity.POLICY: {"libgomp": "OMP_NUM_THREADS", "libiomp": "OMP_NUM_THREADS"},
}


@dataclass(frozen=True)
class ThreadPools:
    """Processes whose libraries have more threads together than cores can run.

    Attributes:
      pids: the processes.
      threads: that compute in each, the main one included.
      usable_cores: for all of them.
      variables: that set the number of threads, by what a loop mostly does.
      speedup: steps per second with one thread each, over those of the program as it is; None where
        it did not run a second time.
      relative_error: standard error of `speedup`, as a share of it.
    """

    pids: Sequence[NonNegativeInt]
    threads: NonNegativeInt
    usable_cores: NonNegativeInt
    variables: Mapping[Activity, str]
    speedup: PositiveFloat | None = None
    relative_error: NonNegativeFloat = 0.0

    @property
    def environment(self) -> Mapping[str, str]:
        return dict.fromkeys(self.variables.values(), "1")


@dataclass
class MappedLibraries:
    """Which libraries with threads of their own each process has mapped."""

    variables: dict[int, Mapping[Activity, str]] = field(default_factory=dict)

    def look(self, pids: Iterable[int], folder: Path = Path("/proc")) -> None:
        for pid in pids:
            if not self.variables.get(pid):
                with contextlib.suppress(OSError):
                    mapped = (folder / str(pid) / "maps").read_text()
                    self.variables[pid] = {
                        activity: variable
                        for activity, names in _VARIABLES.items()
                        for name, variable in names.items()
                        if name in mapped
                    }


def crowded(
    times: Sequence[ThreadTime],
    of_python: Collection[tuple[int, int]],
    variables: Mapping[int, Mapping[Activity, str]],
    usable_cores: int,
) -> ThreadPools | None:
    """Return the processes whose threads are too many; None where they are not.

    Args:
      of_python: processes and threads that run Python: those of libraries never do.
      variables: by process.
    """
    busy = [each for each in times if each.is_busy]
    native = [each.pid for each in busy if (each.pid, each.tid) not in of_python]
    pids = sorted(pid for pid in set(native) if variables.get(pid))
    if len(pids) < 2:
        return None
    threads = 1 + round(sum(map(native.count, pids)) / len(pids))
    if len(pids) * threads <= usable_cores:
        return None
    return ThreadPools(pids, threads, usable_cores, variables[pids[0]])
