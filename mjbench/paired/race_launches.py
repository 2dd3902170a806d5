"""The launches of a race: a fresh process each, in which paths are timed in turns (see `race`)."""

import contextlib
import functools
import random
from collections.abc import Callable, Iterator, Sequence

from mjbench.comparison.compare import ModelChildren
from mjbench.comparison.plan import Variant
from mjbench.errors import InputError
from mjbench.host.child_connection import ChildError
from mjbench.paired import cores, launch_seeds
from mjbench.paired.launches import Targets, UnableError
from mjbench.paired.race_record import RaceLaunch
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.paths.parallelism import nthread
from mjbench.releases import installs
from mjbench.status import Status

# Rounds of a launch: even numbers, because every second one runs in the opposite order. Long blocks
# average what short ones need more rounds for.
ROUNDS, LONG_ROUNDS = 4, 2
# Blocks of `LONG_ROUNDS` are long where they take this time together.
LONG_NS = 10_000_000_000


class RaceLaunches(Targets[RaceLaunch]):
    """Makes the launches of a race, one after the other."""

    def __init__(self, pool: WorkerPool, verified: ModelChildren, variants: Sequence[Variant]):
        """Start nothing yet; `verified` has saved the work of each launch."""
        self._pool, self._verified, self._variants = pool, verified, variants
        self._release = installs.parse_release(installs.INSTALLED)
        self._seeds = launch_seeds.schedule(random.Random(), launch_seeds.launches_of_a_program())

    def launch(self, positions: Sequence[int]) -> RaceLaunch:
        """Time the variants at these positions in a fresh process."""
        plan, files = self._verified.plan, self._verified.files
        name = f"{self._verified.source.name} in a fresh process"
        process = self._pool.start(self._release, name, seeds=next(self._seeds))
        try:
            process.ask(
                Worker.equip_race,
                files.model,
                files.workload,
                plan.returns,
                sorted(cores.USABLE),
                plan.import_from,
            )
            self._pool.wait_for(process, self._release)
            most_threads = max(nthread(self._variants[i].options) for i in positions)
            had = cores.count(process, most_threads)
            prepared = random.sample(list(positions), len(positions))
            for position in prepared:
                path, options = self._variants[position].path, self._variants[position].options
                with _attributed(process, position, "preparing"):
                    process.call(Worker.prepare_entrant, path, dict(options))
            rows = time_rounds(
                functools.partial(self._time_round, process, prepared), len(prepared)
            )
        finally:
            self._pool.end([process])
        columns = [prepared.index(position) for position in positions]
        ns = [[row[column] for column in columns] for row in rows]
        return RaceLaunch(had, list(positions), ns)

    def _time_round(
        self, process: WorkerProcess, prepared: Sequence[int], order: Sequence[int]
    ) -> list[int]:
        """Return the nanoseconds of a block of each variant, in the order they were prepared."""
        row = [0] * len(order)
        for place, number in enumerate(order):
            position = prepared[number]
            with _attributed(process, position, "timing"):
                timed = process.call(Worker.time_entrant, number, reorders=place == 0)
            if timed.difference:
                raise UnableError(position, Status.DISAGREES, timed.difference)
            row[number] = timed.ns
        return row


@contextlib.contextmanager
def _attributed(process: WorkerProcess, position: int, activity: str) -> Iterator[None]:
    """Raise an UnableError for what a task of a variant raises."""
    try:
        yield
        return
    except InputError as error:
        status, cause = Status.FAILED, str(error).removeprefix(f"{process.name}: ")
    except ChildError as error:
        if position == 0:
            raise
        status, cause = error.ending, error.cause
    raise UnableError(position, status, f"{cause} while {activity}")


def time_rounds(time_round: Callable[[Sequence[int]], list[int]], count: int) -> list[list[int]]:
    """Return the nanoseconds of `count` blocks of each round: fewer rounds where they are long."""
    rows: list[list[int]] = []
    for order in _orders(count):
        if len(rows) == LONG_ROUNDS and sum(map(sum, rows)) > LONG_NS:
            break
        rows.append(time_round(order))
    return rows


def _orders(count: int) -> list[list[int]]:
    """Return the orders of the rounds of a launch: each at random, and then the other way."""
    orders = []
    for _ in range(ROUNDS // 2):
        order = random.sample(range(count), count)
        orders += [order, order[::-1]]
    return orders
