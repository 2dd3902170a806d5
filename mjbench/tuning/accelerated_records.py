"""What a run file stores of a search for settings of MJX or Warp."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mjbench.instrument import stats
from mjbench.instrument.bounds import (
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)
from mjbench.paired.records import LaunchRow, Ratio
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.starts import Starts
from mjbench.status import Status
from mjbench.tuning.accelerated_settings import EngineSetting
from mjbench.tuning.distance import Distance
from mjbench.tuning.records import SAME_ERROR

CONFIDENCE = 0.95


@dataclass(frozen=True)
class EngineProgram:
    """A compiled step with some settings.

    Attributes:
      error: the transfer error: distance of its runs from C's with the present settings, from the
        same starts, over the horizon; None where only time was measured.
      trace_s: seconds from Python to the compiler's input; None where there is no such stage.
      buffer_sizes: of the engine, by its names.
    """

    error: Distance | None
    trace_s: NonNegativeFloat | None
    compile_s: NonNegativeFloat
    buffer_sizes: Mapping[str, int]


@dataclass(frozen=True)
class EngineAttempt:
    """How settings of an engine did in one process, beside the present ones.

    Attributes:
      program: what they compile to; None where they failed.
      samples: raw times of blocks; A is the present settings. None where they failed.
    """

    settings: Sequence[EngineSetting]
    status: Status
    detail: str = ""
    program: EngineProgram | None = None
    samples: LaunchRow | None = None

    @property
    def log_ratio(self) -> float | None:
        """Logarithm of the time of a batched step over that with the present settings."""
        if self.samples is None:
            return None
        return stats.paired_log_ratio(self.samples.orders, np.array(self.samples.ns))

    @property
    def time_ratio(self) -> float | None:
        """Time of a batched step over that with the present settings; None where they failed."""
        log_ratio = self.log_ratio
        return None if log_ratio is None else math.exp(log_ratio)

    @property
    def error_share(self) -> float | None:
        """The transfer error, as a share of the motion; None where it was not measured."""
        return self.program.error.share if self.program and self.program.error else None


@dataclass(frozen=True)
class EngineRecommendation:
    """Settings that are faster in fresh processes, and err no more, from new starts.

    Attributes:
      ratio: time of a batched step over that with the present settings, with the 95 % interval of
        Student's t over processes.
      error: the transfer error: the larger of both looks.
      samples: raw times of each process.
    """

    settings: Sequence[EngineSetting]
    ratio: Ratio
    error: Distance
    program: EngineProgram
    samples: Sequence[LaunchRow]


@dataclass(frozen=True)
class EngineWithdrawal:
    """Settings that the second look did not confirm, and why not, in one sentence."""

    settings: Sequence[EngineSetting]
    reason: str


@dataclass(frozen=True)
class EngineFacts:
    """What settings of an engine are measured by.

    Attributes:
      horizon_s: simulated seconds of each over which errors are compared.
      rounding: distance of C's runs whose starts and controls are rounded to that precision.
    """

    device: str
    precision: Precision
    nrun: PositiveInt
    horizon_s: PositiveFloat
    horizon_ncontrol: PositiveInt
    starts: Starts
    rounding: Distance
    settings: Sequence[EngineSetting]


@dataclass(frozen=True, kw_only=True)
class EngineTuneRecord:
    """A search for settings of MJX or Warp on one model; None is what was not reached.

    Attributes:
      engine: path that steps it, such as `mjx`.
      seed: of starts and controls; the second look has the next one.
      nbatch: simulations of a batched step.
      max_error: the largest transfer error allowed, as a share of the motion; None for that of the
        present settings (see `error_limit`).
      facts: what settings are measured by.
      present: the present settings, from the starts of the search.
      attempts: settings that were tried, alone and together.
      untried: settings for which there was no time.
      front: recommendations, the fastest first.
      withdrawn: what the second look did not confirm.
    """

    record_type: ClassVar[str] = "engine_tune"
    model: str
    engine: str
    status: Status = Status.OK
    detail: str = ""
    seed: int = 0
    nbatch: PositiveInt
    max_error: PositiveFloat | None = None
    facts: EngineFacts | None = None
    present: EngineProgram | None = None
    attempts: Sequence[EngineAttempt] = ()
    untried: NonNegativeInt = 0
    front: Sequence[EngineRecommendation] = ()
    withdrawn: Sequence[EngineWithdrawal] = ()
    seconds: NonNegativeFloat = 0.0

    def best(self) -> EngineRecommendation | None:
        """Return the fastest recommendation; None without one."""
        return self.front[0] if self.front else None


def error_limit(
    max_error: float | None, present: EngineProgram | None, facts: EngineFacts
) -> float:
    """Return the largest transfer error that settings may have, as a share of the motion.

    Unless the user gave one, it is that of the present settings from the same starts, and
    SAME_ERROR more; or what rounding alone makes, if that is more.
    """
    if max_error is not None:
        return max_error
    assert present is not None and present.error is not None, "it was measured"
    return max((1 + SAME_ERROR) * present.error.share, facts.rounding.share)


def log_ratios(samples: Sequence[LaunchRow]) -> list[float]:
    """Return the logarithm of the ratio of times in each process."""
    return [stats.paired_log_ratio(row.orders, np.array(row.ns)) for row in samples]


def mean_ratio(logs: Sequence[float]) -> Ratio:
    """Return the ratio of times over fresh processes, with Student's t interval of their mean.

    Args:
      logs: logarithm of the ratio in each process.
    """
    from scipy import stats as distributions  # late: it takes a second

    mean, count = float(np.mean(logs)), len(logs)
    if count < 2:
        return Ratio(math.exp(mean), None, None)
    error = float(np.std(logs, ddof=1)) / math.sqrt(count)
    half_width = float(distributions.t.ppf((1 + CONFIDENCE) / 2, count - 1)) * error
    return Ratio(math.exp(mean), math.exp(mean - half_width), math.exp(mean + half_width))
