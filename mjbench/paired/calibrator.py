"""How many cores threads get, measured in a process of its own."""

from mjbench.host import machine
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.installs import ReleaseSpec


def countable(nthread: int) -> int:
    """Return how many cores as many threads can get: those beyond the usable cores do not count."""
    return min(machine.usable_cores(), nthread)


def cores_had(process: WorkerProcess, nthread: int) -> float | None:
    """Return how many cores as many threads get in a process now; None of one, which has its own.

    Raises:
      ChildError: the process failed, crashed or did not answer in time.
    """
    count = countable(nthread)
    return process.call(Worker.count_cores, count) if count > 1 else None


class Calibrator:
    """Counts cores; its process starts with the first count, because calibrating takes memory."""

    def __init__(self, pool: WorkerPool, release: ReleaseSpec, nthread: int):
        """Start nothing yet; `release` is what the process imports."""
        self._pool, self._release, self._nthread = pool, release, nthread
        self._process: WorkerProcess | None = None

    def count(self) -> float:
        """Return how many cores as many threads get now.

        Raises:
          ChildError: the process failed, crashed or did not answer in time.
        """
        if countable(self._nthread) == 1:
            return 1.0
        if self._process is None:
            self._process = self._pool.start(self._release)
            self._process.wait()
        return cores_had(self._process, self._nthread) or 1.0

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._pool.end([self._process])
            self._process = None
