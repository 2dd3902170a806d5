"""Results of paths, derived from the records of a comparison; pure functions.

A speed is derived only for a measurement whose final states agree.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from mjbench.comparison.records import MeasurementRecord, ModelRecord, of_model
from mjbench.instrument import stats
from mjbench.instrument.runs import Record
from mjbench.instrument.stats import Estimate
from mjbench.paired.confirmation import ComparedSizes, ConfirmationRecord
from mjbench.paired.contest import ContestRecord
from mjbench.paths import BASE
from mjbench.simulation.accelerated_limits import AcceleratedCheck, Precision
from mjbench.simulation.starts import Starts
from mjbench.simulation.work import Work
from mjbench.simulation.workload import Product
from mjbench.status import Status


@dataclass(frozen=True)
class StepTime:
    """Nanoseconds of one step of one simulation: over blocks, the median and the fastest."""

    median: float
    min: float


@dataclass(frozen=True, kw_only=True)
class PathResult:
    """What a comparison says of one variant; None is what cannot be said.

    Attributes:
      agrees: whether its final states are the reference's.
      agreement: the rule that was held, or the first difference.
      closed_loop: whether a policy can choose each control from the state before it.
      hold: steps per control.
      returns: what every run returned.
      diverged: simulations left out because they diverged.
      warnings: how many of the others raised each warning of MuJoCo.
      steps_per_s: steps of all simulations per second.
      step_ns: nanoseconds of one step of one simulation.
      realtime_factor: simulated seconds per second, all simulations together.
      speedup: over the plain Python loop, in this process; what differs from process to process is
        in the intervals of `advice` alone, so this one has none.
      work: contacts, constraints and solver iterations per step.
      clock_gain: how many times faster it is without MuJoCo's timer, in this process; None
        where that was not timed.
      rounds: blocks that were timed.
      snippet: Python that does what the path does.
      nbatch_asked: simulations that the user asked for; None where mjbench chose.
      precision: of an accelerated path; None for paths that run C.
      device: that an accelerated path ran on.
      compile_s: seconds of the compiler.
      cached_compile_s: the same where its cache holds the program; None where not measured.
      memory_bytes: most memory of the process.
      gpu_memory_bytes: most memory of the GPU.
      check: how far an accelerated path is from C.
      buffer_sizes: sizes of an accelerated engine's buffers, by its names for them.
      overtakes_after_steps: break-even: steps of the plain loop that take as long as compiling and
        running the same number; None where the plain loop is faster.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    status: Status
    detail: str = ""
    agrees: bool | None = None
    agreement: str = ""
    closed_loop: bool = False
    nbatch: int | None = None
    nstep: int | None = None
    hold: int | None = None
    returns: Product | None = None
    starts: Starts | None = None
    diverged: int | None = None
    warnings: Mapping[str, int] | None = None
    steps_per_s: float | None = None
    step_ns: StepTime | None = None
    realtime_factor: float | None = None
    speedup: Estimate | None = None
    clock_gain: float | None = None
    work: Work | None = None
    rounds: int = 0
    snippet: str = ""
    nbatch_asked: int | None = None
    precision: Precision | None = None
    device: str | None = None
    trace_s: float | None = None
    compile_s: float | None = None
    cached_compile_s: float | None = None
    memory_bytes: int | None = None
    gpu_memory_bytes: int | None = None
    check: AcceleratedCheck | None = None
    buffer_sizes: Mapping[str, int] | None = None
    overtakes_after_steps: float | None = None

    @property
    def is_accelerated(self) -> bool:
        """Whether the path compiles first and is held to tolerances."""
        return self.precision is not None

    @property
    def is_judged(self) -> bool:
        """Whether its steps were held to anything.

        An accelerated engine is held to C in unconstrained steps alone; where a contact or another
        constraint acts in every step, there are none.
        """
        return self.check is None or self.check.unconstrained_steps > 0

    @property
    def rate(self) -> float:
        """How fast it is, to compare with others of its model; paired with the base if possible."""
        if self.speedup is not None:
            return self.speedup.median
        assert self.steps_per_s is not None, "only timed results have a rate"
        return self.steps_per_s

    def rate_over(self, other: "PathResult") -> float:
        """Return this path's steps per second over another's."""
        assert self.steps_per_s is not None, "only timed results have a rate"
        assert other.steps_per_s is not None, "only timed results have a rate"
        return self.steps_per_s / other.steps_per_s


_RESULT_FIELDS = {field.name for field in fields(PathResult)}


@dataclass(frozen=True)
class ModelResults:
    """The records of one model at one size, and what follows from them.

    Attributes:
      results: one a variant.
      confirmations: comparisons of two variants in fresh processes.
      contest: the comparison of those that may be the fastest; None where there is none.
    """

    model: ModelRecord
    results: tuple[PathResult, ...]
    confirmations: tuple[ConfirmationRecord, ...] = ()
    contest: ContestRecord | None = None

    @property
    def cores_had(self) -> float | None:
        """The cores that threads got: the median of the calibrations; None without any."""
        return statistics.median(self.model.cores_had) if self.model.cores_had else None

    @property
    def compared_sizes(self) -> ComparedSizes:
        """The sizes of the comparison, in which the plain loop was timed."""
        nbatch, nstep = self.model.nbatch, self.model.nstep
        base = next(result for result in self.results if result.path == BASE)
        assert nbatch and nstep and base.step_ns, "the plain loop was timed"
        return ComparedSizes(nbatch, nstep, 1e-9 * base.step_ns.median)

    @property
    def total_steps(self) -> int | None:
        """The steps that the user will take: those asked for, or one block; None if unknown."""
        if self.model.total_steps or self.model.nbatch is None or self.model.nstep is None:
            return self.model.total_steps
        return self.model.nbatch * self.model.nstep


def derive(
    model: ModelRecord,
    measurements: Sequence[MeasurementRecord],
    others: Sequence[object] = (),
) -> ModelResults:
    """Return the results of one model at one size from its records.

    Args:
      others: records of a run, of which those in fresh processes are taken.
    """
    base = next((m for m in measurements if m.path == BASE and m.is_timed), None)
    timestep = model.facts.timestep if model.facts else 0.0
    results = [replace(_result(m, base, timestep), starts=model.starts) for m in measurements]
    again = again_of(model, others)
    confirmations = tuple(record for record in again if isinstance(record, ConfirmationRecord))
    contests = [record for record in again if isinstance(record, ContestRecord)]
    return ModelResults(model, tuple(results), confirmations, contests[-1] if contests else None)


def derive_all(records: Sequence[Record]) -> list[ModelResults]:
    """Return the results of a whole run, model by model, in the order they were measured.

    Args:
      records: of a run file; those of other types are ignored.
    """
    by_model: dict[tuple[str, int | None], list[Record]] = {}
    for record in records:
        if isinstance(record, ModelRecord | MeasurementRecord | ConfirmationRecord | ContestRecord):
            by_model.setdefault((record.model, record.nbatch_asked), []).append(record)
    models = [record for record in records if isinstance(record, ModelRecord)]
    return [
        derive(model, of_model(model, own), own)
        for model in models
        for own in [by_model[model.model, model.nbatch_asked]]
    ]


def again_of(
    model: ModelRecord, records: Sequence[object]
) -> list[ConfirmationRecord | ContestRecord]:
    """Return the comparisons in fresh processes of a model at one size, from those of a run."""
    return [
        record
        for record in records
        if isinstance(record, ConfirmationRecord | ContestRecord)
        and (record.model, record.nbatch_asked) == (model.model, model.nbatch_asked)
    ]


def _result(
    record: MeasurementRecord, base: MeasurementRecord | None, timestep: float
) -> PathResult:
    shared = {name: value for name, value in vars(record).items() if name in _RESULT_FIELDS}
    untimed = PathResult(**shared, rounds=len(record.samples_s))
    if not record.is_timed:
        return untimed
    steps = steps_per_block(record)
    step_s = statistics.median(record.samples_s) / steps
    return replace(
        untimed,
        steps_per_s=1.0 / step_s,
        step_ns=StepTime(1e9 * step_s, 1e9 * min(record.samples_s) / steps),
        # a stored timestep may be one by which no time passes
        realtime_factor=timestep / step_s if 0 < timestep < math.inf else None,
        speedup=_speedup(record, base) if base else None,
        clock_gain=_clock_gain(record),
        overtakes_after_steps=_break_even_steps(record, base) if base else None,
    )


def steps_per_block(record: MeasurementRecord) -> int:
    """Return the steps of one block, all simulations together."""
    assert record.nbatch is not None, "a timed record has its sizes"
    assert record.nstep is not None, "a timed record has its sizes"
    return record.nbatch * record.nstep


def _speedup(record: MeasurementRecord, base: MeasurementRecord) -> Estimate:
    """Return the speed-up over the base: paired by rounds for C, unpaired for accelerated paths."""
    if record.is_accelerated:
        median = statistics.median(base.samples_s) / statistics.median(record.samples_s)
    else:
        median = stats.median_speedup(base.samples_s, record.samples_s)
    return Estimate(median, None, None)


def _clock_gain(record: MeasurementRecord) -> float | None:
    if not record.without_clock_s:
        return None
    return stats.median_speedup(record.with_clock_s, record.without_clock_s)


def _break_even_steps(record: MeasurementRecord, base: MeasurementRecord) -> float | None:
    if record.compile_s is None:
        return None
    steps = steps_per_block(record)
    saved_s = (statistics.median(base.samples_s) - statistics.median(record.samples_s)) / steps
    spent_s = (record.trace_s or 0.0) + record.compile_s
    return spent_s / saved_s if saved_s > 0 else None
