"""How many cores threads get, measured in a process of its own."""

from mjbench.instrument import machine
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.installs import ReleaseSpec


class Calibrator:
    """Counts cores; its process starts with the first count, because calibrating takes memory."""

    def __init__(self, pool: WorkerPool, release: ReleaseSpec, nthread: int):
        """Start nothing yet.

        Args:
          pool: starts the process.
          release: that it imports.
          nthread: threads to count cores for.
        """
        self._pool, self._release = pool, release
        self._nthread = min(machine.usable_cores(), nthread)
        self._process: WorkerProcess | None = None

    def count(self) -> float:
        """Return how many cores as many threads get now.

        Raises:
          TargetError: the process failed, crashed or did not answer in time.
        """
        if self._nthread == 1:
            return 1.0
        if self._process is None:
            self._process = self._pool.start(self._release)
            self._process.wait()
        return self._process.call(Worker.count_cores, self._nthread)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._pool.end([self._process])
            self._process = None
