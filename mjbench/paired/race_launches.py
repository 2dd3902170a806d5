"""The launches of a race: a fresh process each, in which paths are timed in turns (see `race`)."""

import functools
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.errors import InputError
from mjbench.paired import cores, launch_seeds
from mjbench.paired.calibrator import count_cores
from mjbench.paired.race import UnableError
from mjbench.paired.race_record import RaceLaunch, UnableVariant
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import TargetError, WorkerProcess
from mjbench.paths.parallelism import nthread
from mjbench.releases import installs
from mjbench.status import Status

_T = TypeVar("_T")
# Rounds of a launch: an even number, because every second one runs in the opposite order.
ROUNDS = 4


@dataclass(frozen=True)
class RaceWork:
    """What every launch of a race does, in files of the pool.

    Attributes:
      model_file: the compiled model.
      workload_file: a pickled `PortableWorkload`, with its final states.
    """

    model_file: Path
    workload_file: Path


class RaceLaunches:
    """Makes the launches of a race, one after the other."""

    def __init__(
        self,
        pool: WorkerPool,
        name: str,
        plan: ComparisonPlan,
        variants: Sequence[Variant],
        work: RaceWork,
    ):
        """Start nothing yet.

        Args:
          pool: starts the processes.
          name: of the model, for error messages.
          plan: of the comparison.
          variants: that may be timed.
          work: that they do.
        """
        self._pool, self._name, self._plan, self._work = pool, name, plan, work
        self._variants = variants
        self._release = installs.parse_release(installs.INSTALLED)
        self._seeds = launch_seeds.schedule(random.Random(), launch_seeds.launches_of_a_program())

    def launch(self, positions: Sequence[int], is_final: bool) -> RaceLaunch:
        """Time some variants in a fresh process.

        Args:
          positions: of the variants.
          is_final: whether the race is over.

        Raises:
          UnableError: a variant cannot run, or returns something else than the plain loop.
          TargetError: the plain loop cannot, or the process crashed, hung or failed.
        """
        seeds = next(self._seeds)
        process = self._pool.start(self._release, f"{self._name} in a fresh process", seeds=seeds)
        try:
            process.ask(
                Worker.equip_race,
                self._work.model_file,
                self._work.workload_file,
                self._plan.returns,
                sorted(cores.USABLE),
                self._plan.import_from,
            )
            self._pool.wait_for(process, self._release)
            threads = max(nthread(self._variants[i].options) for i in positions)
            had = count_cores(process, threads)
            prepared = random.sample(list(positions), len(positions))
            for position in prepared:
                path, options = self._variants[position].path, self._variants[position].options
                prepare = functools.partial(
                    process.call, Worker.prepare_entrant, path, dict(options)
                )
                self._attempt(process, position, prepare, "preparing")
            rows = [self._time_round(process, prepared, o) for o in _orders(len(prepared))]
        finally:
            self._pool.end([process])
        columns = [prepared.index(position) for position in positions]
        ns = [[row[column] for column in columns] for row in rows]
        return RaceLaunch(had, list(positions), ns, is_final)

    def _time_round(
        self, process: WorkerProcess, prepared: Sequence[int], order: Sequence[int]
    ) -> list[int]:
        """Return the nanoseconds of a block of each variant, in the order they were prepared."""
        row = [0] * len(order)
        for place, number in enumerate(order):
            position = prepared[number]
            time = functools.partial(process.call, Worker.time_entrant, number, reorders=place == 0)
            timed = self._attempt(process, position, time, "timing")
            if timed.difference:
                raise UnableError(UnableVariant(position, Status.DISAGREES, timed.difference))
            row[number] = timed.ns
        return row

    def _attempt(
        self, process: WorkerProcess, position: int, call: Callable[[], _T], activity: str
    ) -> _T:
        """Return the answer to a call about one variant.

        Raises:
          UnableError: the variant cannot run; the plain loop's is a TargetError.
        """
        try:
            return call()
        except InputError as error:
            status, cause = Status.FAILED, str(error).removeprefix(f"{process.name}: ")
        except TargetError as error:
            if position == 0:
                raise
            status, cause = error.ending, error.cause
        detail = f"{cause} while {activity} {self._variants[position]}"
        raise UnableError(UnableVariant(position, status, detail))


def _orders(count: int) -> list[list[int]]:
    """Return the orders of the rounds of a launch: each at random, and then the other way."""
    orders = []
    for _ in range(ROUNDS // 2):
        order = random.sample(range(count), count)
        orders += [order, order[::-1]]
    return orders
