"""The processes of one launch after the other: those of the next start while one is measured."""

import contextlib
import itertools
import random
from collections.abc import Callable, Collection, Iterator, Sequence

from mjbench.instrument import machine
from mjbench.paired import cores, launch_seeds
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.placement import AS_SHIPPED, PlacementPair

# Asks new processes, of the baseline and the candidate, for what a launch needs, without waiting.
Equip = Callable[[Sequence[WorkerProcess]], None]


class ProcessPairs:
    """Starts two processes for each launch, one in each of two releases.

    A process that fails raises its error in `wait`, so that it does not end the launch before its
    own.
    """

    def __init__(
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        placements: Iterator[PlacementPair] | None = None,
    ):
        """Start the processes of the first launch; `equip` tells all of them what they need.

        Args:
          pool: starts the processes.
          releases: of the baseline and of the candidate.
          names: of the two, for error messages.
          placements: of their libraries, launch by launch, as `placement.schedule` yields them;
            None for as shipped.
        """
        self._pool, self._releases, self._names = pool, releases, names
        self._placements = placements or itertools.repeat(AS_SHIPPED)
        # Every pair of releases begins with programs of its own, started at the same time.
        self._seeds = launch_seeds.schedule(random.Random(), launch_seeds.launches_of_a_program())
        self._equip: Equip | None = None
        # Processes that were started ahead, for the next launch, and where their libraries lie.
        self._next_pair: list[WorkerProcess] = []
        self._next_placements = AS_SHIPPED
        self._start_ahead(cores.USABLE)

    def equip(self, equip: Equip) -> None:
        """Have the processes of every launch asked for what they need, the next one's at once."""
        self._equip = equip
        equip(self._next_pair)

    def wait(self) -> None:
        """Wait until the processes of the next launch are ready.

        Raises:
          InputError: what they were asked for cannot be.
          TargetError: one crashed, hung or failed.
        """
        if not self._next_pair:
            self._start_ahead(cores.USABLE)
        try:
            for process, release in zip(self._next_pair, self._releases, strict=True):
                self._pool.wait_for(process, release)
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def launch(
        self, core: int | None
    ) -> Iterator[tuple[tuple[WorkerProcess, WorkerProcess], PlacementPair]]:
        """Yield the processes of a launch, which must be ready, and where their libraries lie.

        This process is pinned to a core in the meantime, and the processes of the next launch start
        on the others. The processes of this one end with the block.

        Args:
          core: that the launch is measured on; None for all, where nothing else may run.
        """
        baseline, candidate = self._next_pair
        self._next_pair = []
        placements = self._next_placements
        others: Collection[int] = ()
        if core is not None and machine.usable_cores() > 1:
            others = cores.USABLE - {core}
        try:
            with cores.pinned(core):
                if others:
                    self._start_ahead(others)
                yield (baseline, candidate), placements
            cores.confine([process.pid for process in self._next_pair], cores.USABLE)
        finally:
            self._pool.end([baseline, candidate])

    def is_next_ready(self) -> bool:
        """Return whether nothing is started ahead that is still starting."""
        return all(process.is_ready() for process in self._next_pair)

    def close(self) -> None:
        """End the processes that were started ahead."""
        self._pool.end(self._next_pair)
        self._next_pair = []

    def _start_ahead(self, allowed: Collection[int]) -> None:
        """Start the processes of the next launch on the allowed cores, without waiting for them."""
        seeds = next(self._seeds)
        pair = self._next_placements = next(self._placements)
        placements = (pair.old, pair.new)
        started: dict[int, WorkerProcess] = {}
        try:
            for i in random.sample((0, 1), 2):  # neither of the two is always the first
                started[i] = self._pool.start(
                    self._releases[i], self._names[i], placements[i], i, allowed, seeds
                )
        except BaseException:
            self._pool.end(list(started.values()))
            raise
        self._next_pair = [started[0], started[1]]
        if self._equip is not None:
            self._equip(self._next_pair)
