"""The time of a step or an operation in a release over that in a fixed one, launch by launch.

Releases that were measured months apart can be compared by it, because the machine's drift hits
both. `python -m benchmarks.history measure` stores it, one record for a model or an operation
and a release.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from benchmarks.history.log_estimates import LogEstimate
from mjbench.bounds import (
    AnyFloat,
    LogRatio,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    Version,
)
from mjbench.releases.placement import Placement
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import Starts
from mjbench.simulation.state_drift import RunDrift
from mjbench.status import FINISHED, Status

# The release that all are compared with.
REFERENCE = "4.0.0"
# Launches of a ratio: whole turns of the schedule of placements, so that each residue has as many.
# There are two turns at least, and ten at most.
SCHEDULE_LAUNCHES, MIN_LAUNCHES, MAX_LAUNCHES = 9, 18, 90
# No launch is added that would end later than so many seconds after the release's first began.
TARGET_S = 110.0
# From so many launches on, they end once the standard error is this small. Fewer say too little of
# their own spread: of launches in two modes, all of the first ones may be of one mode.
TRUSTED_LAUNCHES, TARGET_DEVIATION = 36, 0.002
# The least standard error, since few launches can agree by chance. Estimates between builds of
# equal code have a root mean square of 0.18 % (docs/method/history.md).
MIN_DEVIATION = 0.001
# A launch further from the median of its residue than this many deviations counts as if it were
# that far away: something else on the machine disturbed it.
CLIP_DEVIATIONS = 4.0
# The standard deviation of normal samples over the median of their absolute differences.
_NORMAL_DEVIATIONS = 1.4826
# What placement adds to the deviation where it is not averaged out (the same pairs, as shipped).
PLACEMENT_DEVIATION = 0.012


@dataclass(frozen=True)
class LaunchRatio:
    """What one launch says.

    Attributes:
      log_ratio: natural logarithm of the release's time over the reference's.
      placement: of the libraries of both; None as shipped.
    """

    log_ratio: LogRatio
    placement: Placement | None = None


def averaged(launches: Sequence[LaunchRatio]) -> LogEstimate | None:
    """Return the ratio with placement averaged out; None with too few launches.

    Where nothing was moved, it is the ratio as shipped, with what placement adds to its deviation.
    """
    moved = [launch for launch in launches if launch.placement is not None]
    if not moved:
        shipped = _estimate([launch.log_ratio for launch in launches], None)
        if shipped is None:
            return None
        return LogEstimate(shipped.log_ratio, math.hypot(shipped.deviation, PLACEMENT_DEVIATION))
    residues = [launch.placement.residue for launch in moved if launch.placement]
    return _estimate([launch.log_ratio for launch in moved], residues)


def as_shipped(launches: Sequence[LaunchRatio]) -> LogEstimate | None:
    """Return the ratio of the launches that moved nothing; None with fewer than two.

    They are few, and may agree by chance: their deviation is at least that
    which all launches have of those with the same placement.
    """
    shipped = [launch.log_ratio for launch in launches if launch.placement is None]
    ratio = _estimate(shipped, None)
    if ratio is None or len(shipped) == len(launches):
        return ratio
    groups: dict[int, list[float]] = {}
    for launch in launches:
        residue = -1 if launch.placement is None else launch.placement.residue
        groups.setdefault(residue, []).append(launch.log_ratio)
    squares = sum(len(group) * statistics.pvariance(group) for group in groups.values())
    freedom = len(launches) - len(groups)
    deviation = math.sqrt(squares / freedom / len(shipped))
    return LogEstimate(ratio.log_ratio, max(deviation, ratio.deviation))


def _estimate(log_ratios: Sequence[float], residues: Sequence[int] | None) -> LogEstimate | None:
    count = len(set(residues)) if residues else 1
    if len(log_ratios) <= count:
        return None
    estimate = LogEstimate.of_launches(clipped(log_ratios, residues), residues)
    return replace(estimate, deviation=max(estimate.deviation, MIN_DEVIATION))


def clipped(log_ratios: Sequence[float], residues: Sequence[int] | None = None) -> list[float]:
    """Return log ratios of launches, none further from its residue's median than CLIP_DEVIATIONS.

    The deviation is estimated from the median of absolute differences, without as many of the
    smallest as medians fit by themselves. It is at least MIN_DEVIATION.
    """
    groups = residues or [0] * len(log_ratios)
    medians = {
        group: statistics.median(x for x, g in zip(log_ratios, groups, strict=True) if g == group)
        for group in set(groups)
    }
    centres = [medians[group] for group in groups]
    distances = sorted(abs(x - c) for x, c in zip(log_ratios, centres, strict=True))
    spread = statistics.median(distances[len(medians) - 1 :])
    most = CLIP_DEVIATIONS * max(_NORMAL_DEVIATIONS * spread, MIN_DEVIATION)
    return [min(max(x, c - most), c + most) for x, c in zip(log_ratios, centres, strict=True)]


def are_enough(launches: Sequence[LaunchRatio], seconds: float) -> bool:
    """Return whether no more launches are needed, or too little time is left for them."""
    count = len(launches)
    if count < MIN_LAUNCHES or count % SCHEDULE_LAUNCHES:
        return False
    if count >= MAX_LAUNCHES or seconds * (count + SCHEDULE_LAUNCHES) / count > TARGET_S:
        return True
    ratio = averaged(launches) if count >= TRUSTED_LAUNCHES else None
    return ratio is not None and ratio.deviation <= TARGET_DEVIATION


def completed_share(count: int, seconds: float) -> float:
    """Return the share of a release's launches that is done, at least."""
    return min(1.0, max(count / MAX_LAUNCHES, seconds / TARGET_S))


@dataclass(frozen=True, kw_only=True)
class RatioRecord:
    """What one model or operation and one release took, as run files store it; None is not known.

    Attributes:
      model: its name; empty for an operation that builds its own.
      build: tells builds of one version apart.
      problem: why the libraries were not moved; empty where they were.
      drift: largest difference of what both computed.
      reference_s: seconds of one step or operation of the reference, the median of all launches.
      seconds: its share of the time that its release took.
    """

    record_type: ClassVar[str]
    model: str
    release: Version
    build: str
    reference: Version
    status: Status
    detail: str = ""
    launches: Sequence[LaunchRatio] = ()
    problem: str = ""
    drift: AnyFloat | None = None
    reference_s: PositiveFloat | None = None
    seconds: NonNegativeFloat = 0.0

    @property
    def series(self) -> str:
        return self.model


@dataclass(frozen=True, kw_only=True)
class StepRatioRecord(RatioRecord):
    """The time of a step, of one model and one release.

    `drift` is the largest difference of qpos, qvel and act one step after the same states.

    Attributes:
      workload: digest of start states and controls; equal digests are equal work.
      diverged: simulations that diverged in the release; none of them is timed.
      run_drift: largest differences for runs from the same starts, at several points.
    """

    record_type: ClassVar[str] = "step_ratio"
    workload: str = ""
    work: Work | None = None
    reference_work: Work | None = None
    diverged: NonNegativeInt = 0
    reference_diverged: NonNegativeInt = 0
    run_drift: Sequence[RunDrift] = ()
    nbatch: PositiveInt | None = None
    nstep: PositiveInt | None = None
    starts: Starts | None = None


@dataclass(frozen=True, kw_only=True)
class OperationRatioRecord(RatioRecord):
    """The time of an operation around `mj_step`, in one release.

    `drift` is the largest difference of its results, which are to be the same; None where they
    differ in size.

    Attributes:
      title: the operation in Python, as people write it.
      repeats: how often a block does it.
    """

    record_type: ClassVar[str] = "operation_ratio"
    operation: str
    title: str
    repeats: PositiveInt = 1

    @property
    def series(self) -> str:
        return self.operation


def finished(records: Sequence[object]) -> list[RatioRecord]:
    """Return the records of a run file that need not be measured again when it is continued."""
    return [r for r in records if isinstance(r, RatioRecord) and r.status in FINISHED]
