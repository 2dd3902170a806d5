"""How many threads, which chunk size, how many simulations: what is asked, run and measured.

Each run of a search is a comparison of its own (`compare.compare_model`). It has the plain loop,
one thread of every path, and what is to be tried, so every speed is relative to another one in the
same rounds. `scaling_search` says which run comes next.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

from mjbench import paths
from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.comparison.sizes import NBATCH
from mjbench.errors import InputError
from mjbench.instrument import stats
from mjbench.instrument.stats import Estimate
from mjbench.instrument.topology import Topology
from mjbench.paths.parallelism import WORKER_OPTIONS, nthread
from mjbench.status import FINISHED

# Paths that are searched unless the user names others: for open and for closed loop.
USUAL_PATHS = ("rollout", "batch_step")
# A number is enough where it reaches this share of the best speed-up.
ENOUGH = 0.95
# Simulations for each of the most threads that are tried.
NBATCH_PER_THREAD = 4


class Stage(StrEnum):
    """What a run of a search varies."""

    THREADS = "threads"
    CHUNK = "chunk size"
    NBATCH = "simulations"


@dataclass(frozen=True, kw_only=True)
class ScalingRecord:
    """One run of a search, on one model with one number of simulations.

    Attributes:
      stage: what it varies.
      topology: the cores that it may use.
      model: what a comparison says of the model.
      measurements: one a variant.
    """

    record_type: ClassVar[str] = "scaling"
    stage: Stage
    topology: Topology
    model: ModelRecord
    measurements: Sequence[MeasurementRecord]

    @property
    def is_finished(self) -> bool:
        """Whether it need not be made again when a search is continued."""
        statuses = {self.model.status, *(m.status for m in self.measurements)}
        return statuses <= FINISHED


@dataclass(frozen=True)
class ScalingRun:
    """A run to make.

    Attributes:
      stage: what it varies.
      plan: of the comparison.
    """

    stage: Stage
    plan: ComparisonPlan

    def is_of(self, record: ScalingRecord, model: str) -> bool:
        """Return whether a record is the result of this run on a model."""
        variants = [Variant(m.path, m.options) for m in record.measurements]
        own = (model, self.stage, self.plan.nbatch, list(self.plan.variants))
        return (record.model.model, record.stage, record.model.nbatch_asked, variants) == own


@dataclass(frozen=True)
class ScalingRequest:
    """What to search.

    Attributes:
      plan: of the comparisons; its variants, sizes and budget are replaced.
      path_names: to search, each with threads or worker processes.
      options: of all paths, by name.
      topology: the cores that may be used.
      thread_counts: to try; None to search.
      chunk_sizes: to try; None to search.
      nbatch: numbers of simulations to try; None to search. Threads and chunk sizes are tried with
        the largest.
    """

    plan: ComparisonPlan
    path_names: Sequence[str]
    options: Mapping[str, Any]
    topology: Topology
    thread_counts: Sequence[int] | None = None
    chunk_sizes: Sequence[int] | None = None
    nbatch: Sequence[int] | None = None

    def __post_init__(self) -> None:
        """Check the paths.

        Raises:
          InputError: one has neither threads nor worker processes.
        """
        for name in self.path_names:
            if parallel_option(name) is None:
                raise InputError(f"--scaling: {name} has no threads to vary")

    @property
    def first_counts(self) -> list[int]:
        """The numbers of threads that are tried first."""
        if self.thread_counts is not None:
            return sorted({1, *self.thread_counts})
        most = self.topology.usable
        powers = {2**i for i in range(int(math.log2(most)) + 1)}
        return sorted({*powers, *self.topology.thread_counts(), 2 * most})

    @property
    def first_nbatch(self) -> int:
        """The number of simulations with which threads and chunk sizes are tried."""
        return max(self.nbatch or [NBATCH, NBATCH_PER_THREAD * max(self.first_counts)])

    def variant(self, path_name: str, count: int, chunk: int | None = None) -> Variant:
        """Return a path with a number of threads, and a chunk size unless it is the path's own."""
        parallel = parallel_option(path_name)
        assert parallel is not None, "checked when the request was created"
        path = paths.find(path_name)
        known = {option.name for option in path.options}
        options = {name: value for name, value in self.options.items() if name in known}
        options[parallel] = count
        if chunk is not None:
            options["chunk"] = chunk
        return Variant(path_name, path.complete(options))


@dataclass(frozen=True)
class ScalingPoint:
    """One path with its threads and chunk size, with one number of simulations.

    Attributes:
      stage: of the run.
      variant: the path and its options.
      nbatch: simulations.
      nstep: steps of each.
      step_s: seconds of one step of one simulation, the median.
      speedup: over the plain loop in the same rounds.
      over_one: over one thread of the same path in the same rounds; None where that was not timed.
      over_usual: over the path's own chunk size, with the same threads, in the same rounds; None
        where that was not timed.
      cores_had: that threads got in this run, the median of its calibrations; None without rounds.
    """

    stage: Stage
    variant: Variant
    nbatch: int
    nstep: int
    step_s: float
    speedup: Estimate
    over_one: Estimate | None
    over_usual: Estimate | None
    cores_had: float | None

    @property
    def nthread(self) -> int:
        """Threads or worker processes."""
        return nthread(self.variant.options)

    @property
    def chunk(self) -> int | None:
        """The chunk size; None for the path's own."""
        return self.variant.options.get("chunk")

    @property
    def efficiency(self) -> float | None:
        """The speed-up over one thread, as a share of the cores that there really were.

        That is the share of `min(threads, cores_had)`, which threads without any loss would reach.
        """
        if self.over_one is None or self.cores_had is None:
            return None
        return self.over_one.median / min(self.nthread, self.cores_had)


def parallel_option(path_name: str) -> str | None:
    """Return the option of a path that sets its threads or worker processes; None without one."""
    names = [option.name for option in paths.find(path_name).options]
    return next((name for name in WORKER_OPTIONS if name in names), None)


def points(record: ScalingRecord) -> list[ScalingPoint]:
    """Return what a run says of each variant that was timed, the plain loop left out."""
    timed = [m for m in record.measurements if m.is_timed]
    base = next((m for m in timed if m.path == paths.BASE), None)
    if base is None:
        return []
    return [_point(record, m, timed, base) for m in timed if m is not base]


def _point(
    record: ScalingRecord,
    measurement: MeasurementRecord,
    timed: Sequence[MeasurementRecord],
    base: MeasurementRecord,
) -> ScalingPoint:
    nbatch, nstep = measurement.nbatch, measurement.nstep
    assert nbatch and nstep, "what was timed has its sizes"
    same_path = [m for m in timed if m.path == measurement.path]
    usual_options = {n: v for n, v in measurement.options.items() if n != "chunk"}
    one = [m for m in same_path if nthread(m.options) == 1]
    usual = [m for m in same_path if m.options == usual_options]
    own, cores = measurement.samples_s, record.model.cores_had
    return ScalingPoint(
        stage=record.stage,
        variant=Variant(measurement.path, measurement.options),
        nbatch=nbatch,
        nstep=nstep,
        step_s=statistics.median(measurement.samples_s) / (nbatch * nstep),
        speedup=stats.speedup_in_common(base.samples_s, own),
        over_one=stats.speedup_in_common(one[0].samples_s, own) if one else None,
        over_usual=stats.speedup_in_common(usual[0].samples_s, own) if usual else None,
        cores_had=statistics.median(cores) if cores else None,
    )


def knee(speedup_by_number: Mapping[int, float]) -> int:
    """Return the smallest number that is sufficient."""
    return sufficient(speedup_by_number)[0]


def sufficient(speedup_by_number: Mapping[int, float]) -> list[int]:
    """Return the numbers whose speed-up is at least ENOUGH of the best, from the smallest on."""
    best = max(speedup_by_number.values())
    return sorted(n for n, speedup in speedup_by_number.items() if speedup >= ENOUGH * best)


def knees(all_points: Sequence[ScalingPoint]) -> dict[str, int]:
    """Return the knee of each path among its numbers of threads.

    Args:
      all_points: of a search on one model; a later one of the same variant counts.
    """
    return {path: knee(speedups) for path, speedups in speedups_by_threads(all_points).items()}


def speedups_by_threads(all_points: Sequence[ScalingPoint]) -> dict[str, dict[int, float]]:
    """Return speed-ups over one thread, by path and number of threads."""
    speedups: dict[str, dict[int, float]] = {}
    for point in all_points:
        if point.stage == Stage.THREADS and point.over_one is not None:
            speedups.setdefault(point.variant.path, {})[point.nthread] = point.over_one.median
    return speedups
