"""How many threads a path should have, which chunk size, and how many simulations.

Rows and advice follow from the records of a search (`comparison.scaling`).
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench import paths
from mjbench.comparison import scaling
from mjbench.comparison.plan import Variant
from mjbench.comparison.scaling import ScalingPoint, ScalingRecord, Stage
from mjbench.instrument.stats import Estimate
from mjbench.instrument.topology import Beyond, Topology
from mjbench.paired import confirmation
from mjbench.paired.confirmation import MIN_EFFECT, ComparedSizes, ConfirmationRecord
from mjbench.report.advice import Pairing, is_certainly_faster
from mjbench.status import Status


@dataclass(frozen=True, kw_only=True)
class ScalingRow:
    """One path with its threads and chunk size, with one number of simulations.

    Attributes:
      stage: what the run varied.
      nthread: threads or worker processes.
      chunk: simulations that a thread takes at a time; None for the path's own.
      step_ns: nanoseconds of one step of one simulation, the median of the blocks.
      speedup: over the plain loop, in this process.
      over_one: over one thread of the same path, likewise; None where that was not timed.
      over_usual: over the path's own chunk size, likewise; None where that was not timed.
      cores_had: cores that threads got in this run; None without a calibration.
      efficiency: `over_one` as a share of the cores that so many threads can have had.
      beyond: what so many threads exceed.
    """

    model: str
    stage: Stage
    path: str
    options: Mapping[str, Any]
    nthread: int
    chunk: int | None
    nbatch: int
    nstep: int
    step_ns: float
    speedup: float
    over_one: float | None
    over_usual: float | None
    cores_had: float | None
    efficiency: float | None
    beyond: Sequence[Beyond]


@dataclass(frozen=True, kw_only=True)
class ThreadAdvice:
    """How many threads a path should have on a model.

    Attributes:
      options: of the path, with the threads and the chunk size to use.
      closed_loop: whether a policy can choose each control from the state before it.
      nthread: the smallest number of threads that is about as fast as any, and certainly faster
        than one; otherwise 1.
      knee: the smallest number of threads that reached 95 % of the best speed-up in the search.
      most_tried: the largest number of threads that was tried.
      nbatch: simulations with which threads were tried.
      speedup: of `knee` threads over one, in fresh processes; None where that was not measured.
      low: lower end of its 95 % interval.
      detail: why it was not measured, in one line; empty where it was.
      efficiency: of `knee` threads, in the search.
      cores_had: cores that threads got; None without a calibration.
      chunk: the chunk size that is certainly faster than the path's own; None without one.
      chunk_speedup: its speed-up, in fresh processes; None without one.
      good_nbatch: the numbers of simulations with which `knee` threads have 95 % of their best
        speed-up over the plain loop, from the smallest on.
      nbatch_tried: the numbers of simulations that were tried, from the smallest on.
      snippet: Python that does what the path does.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    closed_loop: bool
    nthread: int
    knee: int
    most_tried: int
    nbatch: int
    speedup: float | None
    low: float | None
    high: float | None
    detail: str
    efficiency: float | None
    cores_had: float | None
    chunk: int | None
    chunk_speedup: float | None
    good_nbatch: Sequence[int]
    nbatch_tried: Sequence[int]
    snippet: str


@dataclass(frozen=True)
class ScalingResults:
    """The records of a search on one model.

    Attributes:
      confirmations: comparisons of two variants in fresh processes.
    """

    records: tuple[ScalingRecord, ...]
    confirmations: tuple[ConfirmationRecord, ...] = ()

    @property
    def topology(self) -> Topology:
        """The cores that the search could use."""
        return self.records[0].topology

    @functools.cached_property
    def points(self) -> list[ScalingPoint]:
        """What the runs say of each variant that was timed."""
        return [point for record in self.records for point in scaling.points(record)]

    @property
    def compared_sizes(self) -> ComparedSizes:
        """The sizes with which threads were tried; needs a point."""
        point = self.points[0]
        return ComparedSizes(point.nbatch, point.nstep, point.step_s * point.speedup.median)

    def rows(self) -> list[ScalingRow]:
        """Return a row for each variant that was timed."""
        model = self.records[0].model.model
        return [
            ScalingRow(
                model=model,
                stage=point.stage,
                path=point.variant.path,
                options=point.variant.options,
                nthread=point.nthread,
                chunk=point.chunk,
                nbatch=point.nbatch,
                nstep=point.nstep,
                step_ns=1e9 * point.step_s,
                speedup=point.speedup.median,
                over_one=_median(point.over_one),
                over_usual=_median(point.over_usual),
                cores_had=point.cores_had,
                efficiency=point.efficiency,
                beyond=self.topology.beyond(point.nthread),
            )
            for point in self.points
        ]

    def advice(self) -> list[ThreadAdvice]:
        """Return the advice on each path that was timed."""
        knees = scaling.knees(self.points)
        return [self._advice(name, count) for name, count in knees.items()]

    def next_pairing(self) -> Pairing | None:
        """Return the next comparison that the advice needs; None where it has all.

        A chunk size is compared again only with threads that are certainly faster than one.
        """
        for name, count in scaling.knees(self.points).items():
            own = [point for point in self.points if point.variant.path == name]
            one, many, chunked = _last(own, 1), _last(own, count), _best_chunk(own)
            if many is one:
                continue
            again = self._confirmation(one.variant, many.variant)
            if again is None:
                return Pairing(one.variant, many.variant)
            if chunked is None or not is_certainly_faster(again.ratio, 1.0):
                continue
            if self._confirmation(many.variant, chunked.variant) is None:
                return Pairing(many.variant, chunked.variant)
        return None

    def _advice(self, name: str, count: int) -> ThreadAdvice:
        own = [point for point in self.points if point.variant.path == name]
        one, many, chunked = _last(own, 1), _last(own, count), _best_chunk(own)
        again = self._confirmation(one.variant, many.variant)
        ratio = again.ratio if again and again.status == Status.OK else None
        chosen, chunk_speedup = one, None
        if is_certainly_faster(ratio, 1.0):
            chosen = many
            chunk_speedup = self._chunk_speedup(many, chunked) if chunked else None
        if chunked is not None and chunk_speedup is not None:
            chosen = chunked
        speed_by_nbatch = {
            point.nbatch: point.speedup.median
            for point in own
            if point.nthread == count and point.chunk is None
        }
        return ThreadAdvice(
            model=self.records[0].model.model,
            path=name,
            options=chosen.variant.options,
            closed_loop=paths.find(name).closed_loop,
            nthread=chosen.nthread,
            knee=count,
            most_tried=max(point.nthread for point in own),
            nbatch=many.nbatch,
            speedup=1 / ratio.estimate if ratio else None,
            low=1 / ratio.high if ratio and ratio.high else None,
            high=1 / ratio.low if ratio and ratio.low else None,
            detail=again.detail if again else "",
            efficiency=many.efficiency,
            cores_had=many.cores_had,
            chunk=chosen.chunk,
            chunk_speedup=chunk_speedup,
            good_nbatch=scaling.sufficient(speed_by_nbatch),
            nbatch_tried=sorted(speed_by_nbatch),
            snippet=self._snippet(chosen.variant),
        )

    def _chunk_speedup(self, usual: ScalingPoint, chunked: ScalingPoint) -> float | None:
        """Return how much faster a chunk size certainly is than the path's own; None if not."""
        again = self._confirmation(usual.variant, chunked.variant)
        ratio = again.ratio if again and again.status == Status.OK else None
        if ratio is None or not is_certainly_faster(ratio, 1 / (1 + MIN_EFFECT)):
            return None
        return 1 / ratio.estimate

    def _confirmation(self, baseline: Variant, candidate: Variant) -> ConfirmationRecord | None:
        return confirmation.of_sides(self.confirmations, baseline, candidate)

    def _snippet(self, variant: Variant) -> str:
        for record in self.records:
            for measurement in record.measurements:
                if Variant(measurement.path, measurement.options) == variant:
                    return measurement.snippet
        return ""


def by_model(
    records: Sequence[ScalingRecord], confirmations: Sequence[ConfirmationRecord]
) -> list[ScalingResults]:
    """Return the results of each model, in the order they were measured."""
    names = dict.fromkeys(record.model.model for record in records)
    return [
        ScalingResults(
            tuple(record for record in records if record.model.model == name),
            tuple(record for record in confirmations if record.model == name),
        )
        for name in names
    ]


def _last(own: Sequence[ScalingPoint], count: int) -> ScalingPoint:
    """Return the last point of a number of threads in the stage that varies them."""
    return [p for p in own if p.stage == Stage.THREADS and p.nthread == count][-1]


def _best_chunk(own: Sequence[ScalingPoint]) -> ScalingPoint | None:
    """Return the fastest chunk size, where it seems certainly faster than the path's own."""
    tried = [p for p in own if p.stage == Stage.CHUNK and p.chunk is not None and p.over_usual]
    best = max(tried, key=lambda p: p.speedup.median, default=None)
    if best is None or best.over_usual is None or best.over_usual.low is None:
        return None
    is_faster = best.over_usual.low > 1.0 and best.over_usual.median >= 1 + MIN_EFFECT
    return best if is_faster else None


def _median(estimate: Estimate | None) -> float | None:
    return None if estimate is None else estimate.median
