"""The processes of launches: those of the next one start while one is measured."""

import contextlib
import itertools
import random
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench.errors import MjbenchError
from mjbench.host import machine
from mjbench.paired import cores
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.placement import AS_SHIPPED, PlacementPair

# Asks new processes, of the baseline and the candidate, for what a launch needs, without waiting.
Equip = Callable[[Sequence[WorkerProcess]], None]


@dataclass(frozen=True, eq=False)
class ProcessPair:
    """The processes of one launch, and the core that they are measured on; None for all."""

    processes: tuple[WorkerProcess, WorkerProcess]
    placements: PlacementPair
    core: int | None = None


class ProcessPairs:
    """Starts two processes for each launch, one in each of two releases.

    A process that fails raises its error in `wait`, so that it does not end the launches before its
    own.
    """

    def __init__(
        self,
        pool: WorkerPool,
        releases: tuple[ReleaseSpec, ReleaseSpec],
        names: tuple[str, str],
        placements: Iterator[PlacementPair] | None = None,
    ):
        """Start the processes of the first launch; `equip` tells all of them what they need."""
        self._pool, self._releases, self._names = pool, releases, names
        self._placements = placements or itertools.repeat(AS_SHIPPED)
        self._seeds = pool.seeds(releases)
        self._next_seeds = next(self._seeds)
        self._equip: Equip | None = None
        # Those that were started ahead, for the next launch.
        self._next: ProcessPair | None = None
        # Those whose launches are over, and which are ended while the next ones start.
        self._finished: list[ProcessPair] = []
        self._failure: MjbenchError | None = None
        try:
            self._start_ahead(cores.USABLE)
        except BaseException:
            self.close()
            raise

    def equip(self, equip: Equip) -> None:
        """Have the processes of every launch asked for what they need, the next one's now."""
        self._equip = equip
        if self._next is not None:
            equip(self._next.processes)

    def wait(self) -> None:
        """Wait until the processes of the next launch are ready."""
        try:
            if self._failure is not None:
                raise self._failure
            next_pair = self._start_ahead(cores.USABLE)
            for process, release in zip(next_pair.processes, self._releases, strict=True):
                self._pool.wait_for(process, release)
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def launch(self, core: int | None) -> Iterator[ProcessPair]:
        """Yield the processes of a launch, which must be ready, with this thread on their core.

        The processes of the next launch start on other cores meanwhile. Ask nothing of the
        processes of this launch after the block: they are ended now or later.

        Args:
          core: that the launch is measured on; None for all of them, where nothing else may run.
        """
        assert self._next is not None, "`wait` has started them"
        pair, self._next = self._next, None
        others = cores.beside(core) if core is not None and machine.usable_cores() > 1 else ()
        try:
            ahead = self._start_ahead(others) if others else None
            self._end_finished()
            with cores.pinned(core):
                yield replace(pair, core=core)
            if ahead is not None:
                cores.confine([process.pid for process in ahead.processes], cores.USABLE)
        finally:
            self._finished.append(pair)
            if not others:  # nothing starts meanwhile, and what comes next may need all memory
                self._end_finished()

    def is_next_ready(self) -> bool:
        """Return whether nothing is started ahead that is still starting."""
        try:
            return (
                self._failure is not None
                or self._next is None
                or all(process.is_ready() for process in self._next.processes)
            )
        except MjbenchError as error:
            self._failure = error
            return True

    def close(self) -> None:
        if self._next is not None:
            self._finished.append(self._next)
        self._next, self._failure = None, None
        self._end_finished()

    def _end_finished(self) -> None:
        pairs, self._finished = self._finished, []
        self._pool.end([process for pair in pairs for process in pair.processes])

    def _start_ahead(self, allowed: Collection[int]) -> ProcessPair:
        """Return the processes of the next launch; start them if need be, without waiting."""
        if self._next is not None:
            return self._next
        seeds, self._next_seeds = self._next_seeds, next(self._seeds)
        placements = next(self._placements)
        both = (placements.old, placements.new)
        started: dict[int, WorkerProcess] = {}
        try:
            for i in random.sample((0, 1), 2):  # neither of the two is always the first
                started[i] = self._pool.start(
                    self._releases[i], self._names[i], both[i], i, allowed, seeds
                )
            pair = ProcessPair((started[0], started[1]), placements)
            if self._equip is not None:
                self._equip(pair.processes)
            if self._next_seeds.program != seeds.program:
                for i in random.sample((0, 1), 2):
                    release = self._releases[i]
                    self._pool.start_program_early(release, i, allowed, self._next_seeds)
        except BaseException:
            self._pool.end(list(started.values()))
            raise
        self._next = pair
        return pair
