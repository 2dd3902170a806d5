"""How long ticks take, one by one: the distribution of their latency.

A tick of a controller sets the controls and calls `mj_step` for a fixed number of steps.
*Free-running*, each tick begins when the one before has ended; its latency is the time of the call
of `mj_step`. *Paced*, ticks are due at a fixed rate, as in a controller; latency counts from when a
tick was due, so that one that waits for a late one is late as well (otherwise one long pause would
count as one slow tick; G. Tene calls that mistake coordinated omission).
"""

import enum
import gc
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np

from mjbench.bounds import (
    AnyFloat,
    CompressedText,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveInt,
    Share,
    check_measured,
)
from mjbench.commands.latency.options import LatencyOptions
from mjbench.commands.shared_options import check_holds
from mjbench.errors import InputError, one_line
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.options import stored
from mjbench.session import Measurement, of_each_model
from mjbench.simulation import compat, models, reference_run, starts, workload_sampling
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import StartPlan, Starts
from mjbench.simulation.workload import Workload, whole_holds
from mjbench.simulation.workload_sampling import SampleRequest
from mjbench.status import Status

# Ticks to measure unless the user says, as far as the budget allows; no fewer than LEAST_NTICK.
NTICK, LEAST_NTICK = 10_000, 100
# Share of the time for free-running ticks; drawing start states takes as long.
FREE_SHARE = 0.25
# Steps after which a simulation starts again, so that it stays where the model usually is.
RUN_NSTEP = 100
# Ticks before the first that counts.
WARM_UP_NTICK = 200
# A paced tick is waited for asleep until this long before it is due, in nanoseconds, then awake.
SPIN_NS = 200_000
# Slow ticks are those above this quantile.
SLOW = 0.99
# The child may be silent for this many times as long as its work should take.
_PATIENCE = 100
# HdrHistogram keeps this many significant digits of values up to this many nanoseconds (100 s).
DIGITS, LARGEST_NS = 3, 100_000_000_000


class Pace(enum.StrEnum):
    """When a tick begins."""

    FREE = "free-running"
    """When the one before has ended."""
    PACED = "paced"
    """When it is due."""


@dataclass(frozen=True)
class Quantile:
    """A quantile of latency, in nanoseconds."""

    quantile: Share
    ns: NonNegativeFloat


@dataclass(frozen=True)
class SlowFeature:
    """How a feature of slow ticks differs from that of all ticks.

    Attributes:
      name: such as `page faults`.
      slow: mean per slow tick.
      all: mean per tick.
    """

    name: str
    slow: AnyFloat
    all: AnyFloat


@dataclass(frozen=True, kw_only=True)
class LatencyRow:
    """The latency of ticks of a model at one pace; None is what could not be measured.

    Attributes:
      model: its name.
      pace: when ticks begin; None where nothing was measured.
      status: `ok`, or how it failed.
      detail: one line; empty when ok.
      tick: steps of a tick.
      ntick: ticks.
      rate_hz: of paced ticks.
      deadline_s: by which a tick should end.
      missed: ticks that did not.
      quantiles: of latency.
      max_ns: the longest.
      slow: what the ticks above the 99 % quantile have in common.
      work: of a step, on average.
      histogram: all latencies in nanoseconds, as an HdrHistogram (V2, compressed, base64).
      starts: where start states came from.
    """

    record_type: ClassVar[str] = "latency"
    model: str
    pace: Pace | None = None
    status: Status = Status.OK
    detail: str = ""
    tick: PositiveInt = 1
    ntick: NonNegativeInt | None = None
    rate_hz: NonNegativeFloat | None = None
    deadline_s: NonNegativeFloat | None = None
    missed: NonNegativeInt | None = None
    quantiles: Sequence[Quantile] = field(default=())
    max_ns: NonNegativeFloat | None = None
    slow: Sequence[SlowFeature] = field(default=())
    work: Work | None = None
    histogram: CompressedText = ""
    starts: Starts | None = None

    @property
    def one_in_seen(self) -> int:
        """The rarest misses that so many ticks show with 95 % probability, one tick in this many.

        Misses of one tick in n leave 3 n ticks without any with a probability of 5 %.
        """
        return max(1, (self.ntick or 0) // 3)

    def __post_init__(self) -> None:
        check_measured(self, "pace", "ntick", "deadline_s", "missed", "max_ns", "work")


QUANTILES = (0.5, 0.99, 0.999)


def measurement(sources: Sequence[ModelSource], options: LatencyOptions) -> Measurement:
    """Return the measurement of ticks of each model, free-running and paced."""
    check_holds(options.nstep, options.tick, "--tick")
    starts = options.starts

    def measure_model(source: ModelSource, budget_s: float) -> list[LatencyRow]:
        limit_s, end_s = options.time_limit_s, time.monotonic() + budget_s
        return isolate.call(measure_in_child, source, starts, options, end_s, limit_s=limit_s)

    return of_each_model(
        "latency", sources, starts, LatencyRow, measure_model, options.budget, stored(options)
    )


def row(
    latency_ns: np.ndarray,
    features: Mapping[str, np.ndarray],
    deadline_s: float | None,
    tick_s: float,
    rate_hz: float | None = None,
    **facts: Any,
) -> LatencyRow:
    """Return what the ticks of one pace say of latency.

    Args:
      features: what happened in each tick, by name: contacts and solver iterations of its last
        step, garbage collections, page faults, preemptions, and by how much it began late.
      deadline_s: by which a tick should end; None for the time between two paced ticks, or the
        simulated time of a tick.
      tick_s: simulated time of a tick.
      rate_hz: of paced ticks; None for free-running ones.
      facts: other fields of the row.
    """
    if deadline_s is None:
        deadline_s = 1 / rate_hz if rate_hz else tick_s
    slow = latency_ns > np.quantile(latency_ns, SLOW)
    return LatencyRow(
        pace=Pace.PACED if rate_hz else Pace.FREE,
        ntick=len(latency_ns),
        rate_hz=rate_hz,
        deadline_s=deadline_s,
        missed=int((latency_ns > 1e9 * deadline_s).sum()),
        quantiles=[Quantile(q, float(np.quantile(latency_ns, q))) for q in QUANTILES],
        max_ns=float(latency_ns.max()),
        slow=[
            SlowFeature(name, float(values[slow].mean()), float(values.mean()))
            for name, values in features.items()
            if slow.any()
        ],
        histogram=_histogram(latency_ns),
        **facts,
    )


def _histogram(latency_ns: np.ndarray) -> str:
    from hdrh.histogram import HdrHistogram

    histogram = HdrHistogram(1, LARGEST_NS, DIGITS)
    for value, count in zip(*np.unique(latency_ns.astype(int), return_counts=True), strict=True):
        histogram.record_value(min(int(value), LARGEST_NS), int(count))
    return str(histogram.encode().decode())


def histogram_quantiles(encoded: str, quantiles: Sequence[float]) -> list[float]:
    """Return quantiles of latencies in ns from an encoded HdrHistogram; else InputError."""
    from hdrh.histogram import HdrHistogram

    try:
        histogram = HdrHistogram.decode(encoded)
    except Exception as error:  # whatever its parser raises of a damaged text
        raise InputError(f"not an HdrHistogram: {one_line(error)}") from error
    limits = histogram.highest_trackable_value, histogram.significant_figures
    if limits != (LARGEST_NS, DIGITS):  # one with others may take minutes to read
        raise InputError("not a histogram of mjbench: its range or precision is another")
    return [float(histogram.get_value_at_percentile(100 * q)) for q in quantiles]


def measure_in_child(
    source: ModelSource, plan: StartPlan, options: LatencyOptions, end_s: float, channel: Channel
) -> list[LatencyRow]:
    """Time ticks of a model at each pace, until a time of the system's monotonic clock."""
    channel.doing("loading the model")
    model = models.load(source)
    channel.doing("drawing start states")
    step_s = reference_run.step_s(model)
    tick_step_s = options.tick * step_s
    free_s = FREE_SHARE * (end_s - time.monotonic())
    affordable = max(LEAST_NTICK, int(free_s / tick_step_s))
    ntick = (options.nstep or 0) // options.tick or min(NTICK, affordable)
    run_nstep, max_nstep = whole_holds(RUN_NSTEP, options.tick), starts.max_settling_nstep(step_s)
    nrun = -(-(ntick + WARM_UP_NTICK) * options.tick // run_nstep)
    channel.allow_silence(_PATIENCE * step_s * (nrun + 1) * run_nstep)
    sample_request = SampleRequest(
        nrun, run_nstep, options.tick, options.seed, plan, max_nstep, may_shorten=True
    )
    sample = workload_sampling.draw(model, sample_request)
    timestep_s = float(model.opt.timestep)
    rate_hz = options.rate_hz or 1 / (options.tick * timestep_s)
    rows: list[LatencyRow] = []
    for pace in Pace:
        channel.doing(f"timing {pace} ticks")
        is_paced = pace == Pace.PACED
        count = ntick
        if is_paced and options.nstep is None:
            affordable = int((end_s - time.monotonic()) * rate_hz) - WARM_UP_NTICK
            count = max(LEAST_NTICK, min(ntick, affordable))
        total = count + WARM_UP_NTICK
        channel.allow_silence(_PATIENCE * tick_step_s * total + 2 * total / rate_hz)
        end_ns = 1e9 * end_s if options.nstep is None else math.inf
        period_ns = 1e9 / rate_hz if is_paced else 0.0
        measured = record_ticks(sample.workload, count, period_ns, end_ns=end_ns)
        rows.append(
            row(
                *measured,
                options.deadline_s,
                options.tick * timestep_s,
                rate_hz if is_paced else None,
                model=source.name,
                tick=options.tick,
                work=sample.observation.work,
                starts=sample.starts,
            )
        )
    return rows


def record_ticks(
    workload: Workload,
    ntick: int,
    period_ns: float,
    clock: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
    end_ns: float = math.inf,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return (ntick,) latencies in ns, and features by name; a period of 0 ns is for no pace.

    Args:
      end_ns: after this time of the clock, they are as few as allowed.
    """
    model, data = workload.model, mujoco.MjData(workload.model)
    total = ntick + WARM_UP_NTICK
    latency_ns, counters = np.zeros(total), np.zeros((total, len(_FEATURES)))
    usage_now = _usage_function()
    with _Collections() as collections:
        k = 0
        least = WARM_UP_NTICK + LEAST_NTICK
        while k < total and (k < least or end_ns == math.inf or clock() < end_ns):
            run = (k // workload.ncontrol) % workload.nbatch
            compat.restart(model, data, workload.initial_state[run])
            due = clock() + period_ns
            for ctrl in workload.control[run][: total - k]:
                data.ctrl[:] = ctrl
                collected, usage = collections.count, usage_now()
                while period_ns and (left_ns := due - clock()) > 0:
                    if left_ns > SPIN_NS:
                        sleep((left_ns - SPIN_NS) * 1e-9)
                begin = clock()
                mujoco.mj_step(model, data, workload.hold)
                end = clock()
                late_ns = begin - due if period_ns else 0.0
                latency_ns[k] = end - begin + late_ns
                later = usage_now()
                counters[k] = (
                    data.ncon,
                    compat.solver_iterations(data).sum(),
                    collections.count - collected,
                    later.ru_minflt + later.ru_majflt - usage.ru_minflt - usage.ru_majflt,
                    later.ru_nivcsw - usage.ru_nivcsw,
                    1e-3 * late_ns,
                )
                due += period_ns
                k += 1
    counted = slice(WARM_UP_NTICK, k)
    features = {name: counters[counted, i] for i, name in enumerate(_FEATURES)}
    return latency_ns[counted], features


_FEATURES = (
    "contacts",
    "solver iterations",
    "garbage collections",
    "page faults",
    "preemptions",
    "µs of late start",
)


def _usage_function() -> Callable[[], Any]:
    """Return a function for what the system counts of this thread; of the process without Linux."""
    import resource  # Windows has none, and imports this module

    who = getattr(resource, "RUSAGE_THREAD", resource.RUSAGE_SELF)
    return lambda: resource.getrusage(who)


class _Collections:
    def __init__(self) -> None:
        self.count = 0

    def _on_phase(self, phase: str, info: Mapping[str, int]) -> None:
        self.count += phase == "stop"

    def __enter__(self) -> "_Collections":
        gc.callbacks.append(self._on_phase)
        return self

    def __exit__(self, *exception: object) -> None:
        gc.callbacks.remove(self._on_phase)
