"""Which way of stepping is the fastest: a race of paths over launches.

A launch is a fresh process in which every path that is still in the race is timed beside the plain
loop. Paths leave once they are certainly slower than the fastest of their loop. The race ends when
no path that is left can be faster than the fastest by `MARGIN`. Where there is no time for that,
each further launch times the faster half of those that the one before timed. The winner of a race
is flattered by it, so launches after it give the figures of the paths that won, and of the plain
loop.
Where a winner fails in one of these, the race goes on with those that left because of it.

`RaceRule` says which paths the next launch times, `RaceLaunches` makes it (`launches.launch` goes
from one to the other), and `race_record` says what follows.
"""

import contextlib
import functools
import math
import random
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench import paths
from mjbench.errors import Failure, InputError
from mjbench.host import machine
from mjbench.host.child_connection import ChildError
from mjbench.host.conditions import ENOUGH_CORES
from mjbench.paired import cores, memory_layout, race_blocks
from mjbench.paired.launches import StopRule, Targets, UnableError
from mjbench.paired.race_record import (
    BUSY_CORES,
    FINAL_LAUNCHES,
    MAX_LAUNCHES,
    MIN_FINAL_LAUNCHES,
    RaceLaunch,
    RaceRecord,
    UnableVariant,
    undisturbed,
)
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.paths.base import nthread
from mjbench.releases import release_names
from mjbench.status import Status
from mjbench.verification.path_verification import ModelFiles
from mjbench.verification.plan import WITHOUT_TIMER, ComparisonPlan, Variant
from mjbench.verification.records import ModelRecord

# A launch of a few paths takes at least this share of the time of one of all: it starts a process.
_SHARE_OF_START = 0.25
# Rounds of a launch: even numbers, because every second one runs in the opposite order. Long blocks
# average what short ones need more rounds for. A busy launch has twice as many.
ROUNDS, LONG_ROUNDS = 4, 2
# Blocks of `LONG_ROUNDS` are long where they take this time together.
LONG_NS = 10_000_000_000


@dataclass(frozen=True)
class RaceBudget:
    """The time that a race, and the launches after it, may take.

    One launch is begun even after that.
    """

    end_s: float
    clock: Callable[[], float] = time.monotonic

    def left_s(self) -> float:
        return self.end_s - self.clock()


def enter(model: ModelRecord, variants: Sequence[Variant]) -> RaceRecord:
    """Return the race of variants, the plain loop first, on a model, before its first launch."""
    assert model.block_steps is not None, "the paths were verified"
    slow = [i for i, each in enumerate(variants) if paths.find(each.path).starts_slowly]
    compete = [i for i, each in enumerate(variants) if each != WITHOUT_TIMER and i not in slow]
    return RaceRecord(
        model=model.model,
        nbatch_asked=model.nbatch_asked,
        steps=model.block_steps,
        variants=variants,
        groups=[compete, [i for i in compete if paths.find(variants[i].path).closed_loop]],
        slow=slow,
    )


class RaceRule(StopRule[RaceLaunch]):
    """Which variants are launched, for the race and after it; `record` is what is known."""

    def __init__(self, entered: RaceRecord, budget: RaceBudget):
        self.record, self._budget = entered, budget
        self._begin_s = self._launch_s = 0.0
        self._is_narrow = self._is_final = False

    def next_targets(self) -> Sequence[int]:
        racing = self._next_of_race()
        narrow = [] if racing else self._next_narrow()
        self._is_narrow, self._is_final = bool(narrow), not (racing or narrow)
        self._begin_s = self._budget.clock()
        return racing or narrow or self._next_final() or self._next_slow()

    def add(self, launch: RaceLaunch) -> None:
        self._launch_s = self._budget.clock() - self._begin_s
        timed = replace(launch, is_narrow=self._is_narrow, is_final=self._is_final)
        self.record = replace(self.record, launches=[*self.record.launches, timed])

    def withdraw(self, error: UnableError) -> None:
        """Note that a variant is unable; it is not in the next launch."""
        if error.position == 0:
            raise error
        unable = UnableVariant(error.position, error.status, error.detail)
        self.record = replace(self.record, unable=[*self.record.unable, unable])

    def end(self, ending: Failure) -> None:
        """Note how the launches ended, where the rule did not end them."""
        if ending.status != Status.OK:
            status, detail = ending.status, ending.detail
            self.record = replace(self.record, status=status, detail=detail, is_cut_short=True)

    def _next_of_race(self) -> list[int]:
        record = self.record
        if record.is_cut_short or record.is_decided:
            return []
        racing = remaining(record)
        if not record.launches:
            return racing
        final_s = FINAL_LAUNCHES * self._expected_s(finalists(record))
        has_time = self._budget.left_s() >= self._expected_s(racing) + final_s
        if has_time and len(record.launches) < MAX_LAUNCHES:
            return racing
        self.record = replace(record, is_cut_short=True)
        return []

    def _next_narrow(self) -> list[int]:
        record = self.record
        has_final = any(launch.is_final for launch in record.launches)
        if not record.is_cut_short or record.status != Status.OK or has_final:
            return []
        leading = leaders(record)
        # the winners may change, and a launch of a few paths takes longer than their share
        final = max(finalists(record), leading[:3], key=len)
        final_s = (MIN_FINAL_LAUNCHES + 1) * self._expected_s(final)
        has_time = self._budget.left_s() >= self._expected_s(leading) + final_s
        return leading if has_time and len(record.launches) < MAX_LAUNCHES else []

    def _next_final(self) -> list[int]:
        final = finalists(self.record)
        count = self._final_launches_of(final)
        if count < FINAL_LAUNCHES and self._budget.left_s() >= self._expected_s(final):
            return final
        if count < MIN_FINAL_LAUNCHES:
            self.record = replace(self.record, is_cut_short=True)
        return []

    def _next_slow(self) -> list[int]:
        """Return the plain loop and those that start slowly, until they have launches enough."""
        slow = [i for i in self.record.slow if i in self.record.able]
        has_enough = self._final_launches_of(slow) >= MIN_FINAL_LAUNCHES
        return [] if not slow or has_enough else [0, *slow]

    def _final_launches_of(self, positions: Collection[int]) -> int:
        after = [launch for launch in undisturbed(self.record.launches) if launch.is_final]
        return sum(set(positions) <= set(launch.variants) for launch in after)

    def _expected_s(self, positions: Collection[int]) -> float:
        last = self.record.launches[-1]
        block_ns = dict(zip(last.variants, map(sum, zip(*last.ns, strict=True)), strict=True))
        usual_ns = sum(block_ns.values()) / len(block_ns)
        expected_ns = sum(block_ns.get(position, usual_ns) for position in positions)
        share = expected_ns / sum(block_ns.values())
        return self._launch_s * max(share, _SHARE_OF_START)


def remaining(record: RaceRecord) -> list[int]:
    """Return the variants that stay in a race: contenders, the plain loop, and those in no group.

    Before the first launch, those are all but the slow ones.
    """
    if not record.launches:
        return sorted(record.able.difference(record.slow))
    contenders = (standing.contenders for standing in record.standings.values())
    return sorted(_always_timed(record).union(*contenders))


def leaders(record: RaceRecord) -> list[int]:
    """Return what to time where time is short: of each loop the faster half, two at least."""
    halves = (
        standing.leaders[: max(2, math.ceil(len(standing.leaders) / 2))]
        for standing in record.standings.values()
    )
    return sorted({0}.union(*halves))


def finalists(record: RaceRecord) -> list[int]:
    """Return the variants to time after a race: winners, the plain loop, and those in no group."""
    winners = ({each.fastest, each.chosen} for each in record.standings.values())
    return sorted(_always_timed(record).union(*winners))


def _always_timed(record: RaceRecord) -> set[int]:
    return {0} | record.able.difference(record.slow, *record.groups)


class RaceLaunches(Targets[RaceLaunch]):
    """The launches of a race: a fresh process each, in which paths are timed in turns."""

    def __init__(
        self,
        pool: WorkerPool,
        model: str,
        plan: ComparisonPlan,
        files: ModelFiles,
        variants: Sequence[Variant],
    ):
        """Start nothing yet; `files` have the work of each launch."""
        self._pool, self._model, self._plan, self._files = pool, model, plan, files
        self._variants = variants
        self._release = release_names.parse_release(release_names.INSTALLED)
        self._seeds = memory_layout.schedule(random.Random(), memory_layout.launches_of_a_program())

    def launch(self, positions: Sequence[int]) -> RaceLaunch:
        """Time the variants at these positions in a fresh process."""
        name = f"{self._model} in a fresh process"
        process = self._pool.start(self._release, name, seeds=next(self._seeds))
        try:
            process.ask(
                race_blocks.equip,
                self._files.model,
                self._files.workload,
                self._plan.returns,
                sorted(cores.USABLE),
                self._plan.import_from,
            )
            self._pool.wait_for(process, self._release)
            most_threads = max(nthread(self._variants[i].options) for i in positions)
            had = process.count_cores(most_threads)
            prepared = random.sample(list(positions), len(positions))
            for position in prepared:
                path, options = self._variants[position].path, self._variants[position].options
                with _attributed(process, position, "preparing"):
                    process.call(race_blocks.prepare_path, path, dict(options))
            time_round = functools.partial(self._time_round, process, prepared)
            rows, other_cores = time_launch(time_round, len(prepared))
        finally:
            self._pool.end([process])
        lacked_cores = had is not None and had < ENOUGH_CORES * cores.countable(most_threads)
        columns = [prepared.index(position) for position in positions]
        ns = [[row[column] for column in columns] for row in rows]
        return RaceLaunch(had, list(positions), ns, other_cores, lacked_cores)

    def _time_round(
        self, process: WorkerProcess, prepared: Sequence[int], order: Sequence[int]
    ) -> list[int]:
        """Return the nanoseconds of a block of each variant, in the order they were prepared."""
        row = [0] * len(order)
        for place, number in enumerate(order):
            position = prepared[number]
            with _attributed(process, position, "timing"):
                timed = process.call(race_blocks.time_block, number, reorders=place == 0)
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


def time_launch(
    time_round: Callable[[Sequence[int]], list[int]],
    count: int,
    other_programs_s: Callable[[], float] = machine.other_programs_s,
    clock: Callable[[], float] = time.monotonic,
) -> tuple[list[list[int]], float]:
    """Return `time_rounds`, twice as many in a busy launch, and the cores of other programs."""
    others_begin_s, begin_s = other_programs_s(), clock()
    rows = time_rounds(time_round, count)
    other_cores = (other_programs_s() - others_begin_s) / (clock() - begin_s)
    if other_cores >= BUSY_CORES:
        rows += time_rounds(time_round, count)
    return rows, max(0.0, other_cores)


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
