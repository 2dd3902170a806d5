"""Compare the paths of `mjbench compare` that may be the fastest, in fresh processes.

Within one process, its memory and what other paths left in its caches move a ratio by several
percent. Here each launch starts a new process for every path. They take turns in blocks, so a
launch gives a ratio of every two of them. After some launches only those go on that may still be
the fastest, until it is clear which is, or time is up.
"""

import functools
import random
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.errors import InputError
from mjbench.instrument import anytime
from mjbench.instrument.bounds import NonNegativeInt, PositiveFloat, PositiveInt
from mjbench.paired import cores, launch_seeds, preparation, requests
from mjbench.paired.calibrator import Calibrator
from mjbench.paired.confirmation import CONFIDENCE, MIN_EFFECT, ComparedSizes, target
from mjbench.paired.ending import ENDING_ERRORS, ending_of
from mjbench.paired.judgement import MIN_LAUNCHES
from mjbench.paired.records import Ratio
from mjbench.paired.time_limit import OutOfTimeError, TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.paths.parallelism import nthread
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

# Seconds from when the model is loaded, after which no launch begins.
TIME_LIMIT_S = 40.0
# How often a launch lays out its memory anew, and the rounds of each layout: an even number.
LAYOUTS, ROUNDS = 2, 4
# A simpler variant is as fast if its time is within MIN_EFFECT by as many standard errors.
DEVIATIONS = 2.0
_LOG_EFFECT = float(np.log1p(MIN_EFFECT))
# Half the width at which the interval of a speed-up over the first variant of a group will do.
_BASE_PRECISION = 0.05


@dataclass(frozen=True)
class ContestLaunch:
    """One fresh process for each of some variants.

    Attributes:
      cores: how many cores so many threads got just before the launch; None for one thread.
      variants: which of the contest's were timed, by their position.
      ns: (rounds, variants) nanoseconds of blocks. Every second round runs in the opposite order of
        the one before.
    """

    cores: PositiveFloat | None
    variants: Sequence[NonNegativeInt]
    ns: Sequence[Sequence[PositiveInt]]

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
          ValueError: `ns` has not that shape.
        """
        if len(self.ns) % 2 or not self.ns or any(len(r) != len(self.variants) for r in self.ns):
            raise ValueError("ns has a row for each round, as many each way, of all its variants")

    def log_ratio(self, baseline: int, candidate: int) -> float:
        """Return the natural logarithm of one variant's time over another's.

        It is a median over pairs of rounds in opposite orders: the block that comes second is
        slower, so both orders must weigh the same.
        """
        first, second = (list(self.variants).index(i) for i in (baseline, candidate))
        return statistics.median(pair[second] - pair[first] for pair in self._log_times)

    @functools.cached_property
    def _log_times(self) -> list[list[float]]:
        """(pairs of rounds, variants) means of the logarithms of times."""
        logs = np.log(np.asarray(self.ns, dtype=float))
        means: list[list[float]] = logs.reshape(-1, 2, logs.shape[1]).mean(axis=1).tolist()
        return means


@dataclass(frozen=True)
class UnableVariant:
    """A variant that left a contest, because it cannot run beside the others.

    Attributes:
      variant: which of the contest's, by its position.
      detail: why, in one line.
    """

    variant: NonNegativeInt
    detail: str


@dataclass(frozen=True, kw_only=True)
class ContestRecord:
    """The variants on one model that may be the fastest, compared in fresh processes.

    Attributes:
      model: its name.
      nbatch_asked: simulations that the user asked for; None where mjbench chose.
      variants: what was compared.
      unable: those that left, in this order.
      status: how the contest ended.
      detail: one line; empty when ok, unless time ran out before there were enough launches.
      launches: raw times of every launch.
    """

    record_type: ClassVar[str] = "contest"
    model: str
    nbatch_asked: PositiveInt | None = None
    variants: Sequence[Variant]
    unable: Sequence[UnableVariant] = ()
    status: Status
    detail: str = ""
    launches: Sequence[ContestLaunch] = ()

    def __post_init__(self) -> None:
        """Check the positions of variants.

        Raises:
          ValueError: there is no variant at one of them.
        """
        positions = {each.variant for each in self.unable}
        positions.update(*(launch.variants for launch in self.launches))
        if any(position >= len(self.variants) for position in positions):
            raise ValueError(f"it has {len(self.variants)} variants, and names a later one")

    def ratio(self, baseline: Variant, candidate: Variant) -> Ratio | None:
        """Return the candidate's time over the baseline's, with its 95 % interval.

        Both ends are None where launches are too few for an interval; without a launch of the two
        there is no ratio.
        """
        if baseline not in self.variants or candidate not in self.variants:
            return None
        first, second = (self.variants.index(variant) for variant in (baseline, candidate))
        interval = self._interval(first, second)
        if interval is None:
            return None
        if not np.isfinite(interval.half_width):
            return Ratio(float(np.exp(interval.mean)), None, None)
        estimate, low, high = np.exp([interval.mean, interval.low, interval.high])
        return Ratio(float(estimate), float(low), float(high))

    def why_unable(self, variant: Variant) -> str:
        """Return why a variant left the contest, or was not in it; empty where it stayed."""
        if variant not in self.variants:
            return "it was not compared"
        position = self.variants.index(variant)
        return next((each.detail for each in self.unable if each.variant == position), "")

    def fastest(self, variants: Sequence[Variant]) -> Variant:
        """Return the one of some variants, none of which left, that is the fastest by estimate."""
        positions = [self.variants.index(variant) for variant in variants]
        return self.variants[_fastest(self._interval, positions)]

    def choice(self, variants: Sequence[Variant]) -> Variant:
        """Return the simplest of some variants that is within MIN_EFFECT of the fastest.

        It must be so by its estimate and DEVIATIONS standard errors, or a simpler one would be
        chosen the more often, the noisier the machine is.

        Args:
          variants: from the simplest on; none of them left.
        """
        fastest = self.fastest(variants)
        first = self.variants.index(fastest)
        for variant in variants:
            if variant == fastest:
                break
            ratios = _log_ratios(self.launches, first, self.variants.index(variant))
            if len(ratios) < MIN_LAUNCHES:
                continue
            mean, deviation = anytime.mean_and_deviation(ratios)
            if mean + DEVIATIONS * deviation <= _LOG_EFFECT:
                return variant
        return fastest

    def _interval(self, baseline: int, candidate: int) -> anytime.Interval | None:
        key = baseline, candidate
        if key not in self._intervals:
            self._intervals[key] = _interval(self.launches, *key)
        return self._intervals[key]

    @functools.cached_property
    def _intervals(self) -> dict[tuple[int, int], anytime.Interval | None]:
        """The intervals that were computed, by the positions of two variants."""
        return {}


def run(
    pool: WorkerPool,
    source: ModelSource,
    plan: ComparisonPlan,
    groups: Sequence[Sequence[Variant]],
    compared: ComparedSizes,
    time_limit_s: float = TIME_LIMIT_S,
    on_launch: Callable[[int, float], None] = lambda launches, share: None,
    clock: Callable[[], float] = time.monotonic,
) -> ContestRecord:
    """Find the fastest variant of each group, in fresh processes.

    A variant that cannot run beside the others leaves; the others go on while there are two. Where
    a process crashes, hangs or fails, or Ctrl-C is pressed, the record says so, and holds what was
    measured until then.

    Args:
      pool: starts the processes.
      source: the model.
      plan: of the comparison that the variants come from.
      groups: of C paths that compete with each other, each from the simplest on.
      compared: sizes of that comparison.
      time_limit_s: seconds from when the model is loaded, after which no launch begins.
      on_launch: called after each launch, with the number of launches and the share of the limit
        that is spent.
      clock: returns seconds.
    """
    variants = _merged(groups)
    positions = [[variants.index(variant) for variant in group] for group in groups]
    launches: list[ContestLaunch] = []
    unable: list[UnableVariant] = []
    status, detail = Status.OK, ""
    limit = TimeLimit(time_limit_s, MIN_LAUNCHES, clock, "advice")
    try:
        with _Processes(pool, source, plan, variants, compared, limit) as processes:
            before_s = limit.spent_s()
            going_on = list(range(len(variants)))
            while going_on:
                try:
                    launches.append(processes.launch(going_on))
                except _UnableError as error:  # such as for want of memory, beside the others
                    unable.append(UnableVariant(error.variant, str(error)))
                    going_on = [i for i in going_on if i != error.variant]
                    if len(going_on) < 2:
                        raise
                    continue
                on_launch(len(launches), min(limit.spent_s() / time_limit_s, 1.0))
                if not limit.allows_another(len(launches), before_s, can_judge=True):
                    break
                going_on = remaining(launches, positions)
        if len(launches) < MIN_LAUNCHES and going_on:
            detail = f"only {len(launches)} of {MIN_LAUNCHES} launches fit into {time_limit_s:g} s"
    except OutOfTimeError:
        detail = f"its launches take too long for {time_limit_s:g} s"
    except ENDING_ERRORS as error:
        ending = ending_of(error)
        status, detail = ending.status, ending.detail
    return ContestRecord(
        model=source.name,
        nbatch_asked=plan.nbatch,
        variants=variants,
        unable=unable,
        status=status,
        detail=detail,
        launches=launches,
    )


def remaining(launches: Sequence[ContestLaunch], groups: Sequence[Sequence[int]]) -> list[int]:
    """Return the variants that need further launches; none where every group is decided.

    A variant is out of its group once it is certainly slower than the fastest by MIN_EFFECT. A
    group is decided when the intervals of all others are narrow, that of its first variant, too,
    over which the speed-up is given.

    Args:
      launches: so far.
      groups: of variants that compete with each other, by their positions; the first one stays
        while it can run.
    """
    last = launches[-1].variants
    if len(launches) < MIN_LAUNCHES:
        return list(last)
    needed: set[int] = set()
    for group in groups:
        active = [i for i in group if i in last]
        if len(active) < 2:
            continue
        best = _fastest(functools.partial(_interval, launches), active)
        intervals = {i: _interval(launches, best, i) for i in active if i != best}
        near = {i: each for i, each in intervals.items() if each and each.low <= _LOG_EFFECT}
        base = intervals.get(group[0])
        if any(interval.half_width > _LOG_EFFECT / 2 for interval in near.values()) or (
            base is not None and base.half_width > _BASE_PRECISION
        ):
            needed |= {group[0], best, *near}
    return sorted(needed.intersection(last))


def _interval(
    launches: Sequence[ContestLaunch], baseline: int, candidate: int
) -> anytime.Interval | None:
    """Return the interval of the log ratio of two variants; None without a launch of both."""
    ratios = _log_ratios(launches, baseline, candidate)
    return anytime.anytime_interval(ratios, CONFIDENCE) if ratios else None


def _log_ratios(launches: Sequence[ContestLaunch], baseline: int, candidate: int) -> list[float]:
    """Return the log ratios of the launches that timed both variants."""
    return [
        launch.log_ratio(baseline, candidate)
        for launch in launches
        if baseline in launch.variants and candidate in launch.variants
    ]


def _fastest(
    interval_of: Callable[[int, int], anytime.Interval | None], positions: Sequence[int]
) -> int:
    """Return the variant that is faster, by estimate, than each that it was compared with."""
    best = positions[0]
    for i in positions[1:]:
        interval = interval_of(best, i)
        if interval is not None and interval.mean < 0:
            best = i
    return best


def _merged(groups: Sequence[Sequence[Variant]]) -> list[Variant]:
    """Return the variants of all groups, each once."""
    merged: list[Variant] = []
    for group in groups:
        merged += [variant for variant in group if variant not in merged]
    return merged


class _UnableError(InputError):
    """A variant cannot run beside the others.

    Attributes:
      variant: which, by its position.
    """

    def __init__(self, variant: int, message: str):
        super().__init__(message)
        self.variant = variant


class _Processes:
    """The processes of one launch after the other; a context manager."""

    def __init__(
        self,
        pool: WorkerPool,
        source: ModelSource,
        plan: ComparisonPlan,
        variants: Sequence[Variant],
        compared: ComparedSizes,
        limit: TimeLimit,
    ):
        self._pool, self._plan, self._variants, self._limit = pool, plan, variants, limit
        self._release = installs.parse_release(installs.INSTALLED)
        self._nthread = max(nthread(variant.options) for variant in variants)
        self._targets = [target(source, plan, variant) for variant in variants]
        self._sizes = compared.of_blocks(plan, variants)
        self._seeds = launch_seeds.schedule(random.Random(), launch_seeds.launches_of_a_program())
        self._calibrator = Calibrator(pool, self._release, self._nthread)

    def __enter__(self) -> "_Processes":
        """Load the model, and draw the work.

        Raises:
          InputError: it cannot be stepped.
          TargetError: a process crashed, hung or failed.
          OutOfTimeError: the limit does not allow a launch.
        """
        # the two stand for all: what is drawn depends on the model and on the most threads
        pair = (self._targets[0], max(self._targets, key=lambda run: run.nthread))
        self._prepared = preparation.prepare(self._pool, pair, self._sizes, self._limit)
        return self

    def __exit__(self, *exception: object) -> None:
        self._calibrator.close()
        for file in (*self._prepared.models, *self._prepared.workloads):
            file.unlink(missing_ok=True)

    def launch(self, positions: Sequence[int]) -> ContestLaunch:
        """Time some variants, each in a fresh process.

        Raises:
          _UnableError: a variant cannot run.
          TargetError: a process crashed, hung or failed.
        """
        seeds = next(self._seeds)
        processes: dict[int, WorkerProcess] = {}
        try:
            for i in random.sample(positions, len(positions)):
                name = f"{self._variants[i]} in a fresh process"
                processes[i] = self._pool.start(self._release, name, side=i % 2, seeds=seeds)
                run = self._targets[i]
                model, workload = self._prepared.models[0], self._prepared.workloads[0]
                processes[i].ask(requests.Equip(model, workload, run.path, run.import_from))
            for process in processes.values():
                self._pool.wait_for(process, self._release)
            calibrated = self._calibrator.count() if self._nthread > 1 else None
            rows = [
                row
                for _ in range(LAYOUTS)
                for row in self._time_layout([processes[i] for i in positions], positions)
            ]
        finally:
            self._pool.end(list(processes.values()))
        return ContestLaunch(calibrated, list(positions), rows)

    def _time_layout(
        self, processes: Sequence[WorkerProcess], positions: Sequence[int]
    ) -> Iterator[list[int]]:
        """Lay out memory anew, and yield the nanoseconds of one round after the other."""
        nbatch = self._prepared.work_check.nbatch
        rows = random.sample(range(self._prepared.nsim), nbatch)
        for k in random.sample(range(len(processes)), len(processes)):
            run = self._targets[positions[k]]
            request = requests.Prepare(
                path=run.path,
                options=dict(run.options),
                cores=sorted(cores.USABLE),
                simulations=rows,
                returns=self._plan.returns,
            )
            try:
                processes[k].call(request)
            except InputError as error:
                raise _UnableError(positions[k], str(error)) from error
        for process in processes:
            process.ask(requests.TimeBlocks())
        for _ in range(ROUNDS // 2):
            order = random.sample(range(len(processes)), len(processes))
            for turn in (order, order[::-1]):
                ns = {k: processes[k].time_block() for k in turn}
                yield [ns[k] for k in range(len(processes))]
        for process in processes:
            process.end_blocks()
