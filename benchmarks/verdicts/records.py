"""Trials of verdicts whose truth is known: what is compared, what came of it, and its summary."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import ClassVar

from mjbench.bounds import LogRatio, NonNegativeFloat, NonNegativeInt, PositiveFloat
from mjbench.host.disturbance import Disturbance
from mjbench.interval import Interval
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.records import PlacementEffect


class Arm(StrEnum):
    """How the two targets of a trial differ; the truth follows from it."""

    SLOWDOWN = "slowdown"
    """Each block of the candidate lasts longer by a known share; 0 compares identical targets."""
    INSIDE_STEP = "inside_step"
    """Every step of the candidate calls one more function of the engine: it is slower."""
    BETWEEN_BUILDS = "between_builds"
    """Two releases whose steps execute equally many instructions: they should be the same."""


@dataclass(frozen=True, kw_only=True)
class CaseRow:
    """What a trial compares; the truth about it is known.

    Attributes:
      slowdown: of the candidate, as a share of the baseline's time: 0 where the two are the same;
        None where its size is unknown.
      callback: function of the engine that the candidate calls inside each step; empty for none.
      old: MuJoCo release of the baseline.
    """

    arm: Arm = Arm.SLOWDOWN
    model: str
    slowdown: NonNegativeFloat | None
    callback: str = ""
    old: str
    new: str

    @property
    def is_slower(self) -> bool:
        return self.slowdown is None or self.slowdown > 0


@dataclass(frozen=True, kw_only=True)
class TrialRecord(CaseRow):
    """One comparison of which the truth is known.

    Attributes:
      cause: why the times differ; None where they do not, or where more differs than the build.
      estimate: candidate over baseline time.
      low: lower end of its interval; None with too few launches.
      placement: what the placement of code has to do with it; None where builds were compared as
        shipped.
      launches: log ratio of each that the verdict rests on.
      residues: of the placements of these launches; empty where they are as shipped.
      as_shipped: log ratio of each launch as shipped beside them.
    """

    record_type: ClassVar[str] = "trial"
    verdict: Verdict
    cause: Cause | None = None
    estimate: PositiveFloat
    low: PositiveFloat | None
    high: PositiveFloat | None
    placement: PlacementEffect | None = None
    seconds: NonNegativeFloat
    launches: Sequence[LogRatio]
    residues: Sequence[NonNegativeInt] = ()
    as_shipped: Sequence[LogRatio] = ()

    @property
    def ratio(self) -> Interval:
        return Interval(self.estimate, self.low, self.high)

    @property
    def averaged(self) -> bool:
        """Whether the placement of code is averaged out; builds are as shipped otherwise."""
        return self.placement is not None and self.placement.averaged

    @property
    def problem(self) -> str:
        """Why placements are not averaged, although they were to be; empty otherwise."""
        return self.placement.problem if self.placement else ""

    def case(self) -> CaseRow:
        return CaseRow(**{f.name: getattr(self, f.name) for f in fields(CaseRow)})


@dataclass(frozen=True, kw_only=True)
class CaseSummary(CaseRow):
    """What the trials of one case say.

    Attributes:
      averaged: whether they average the placement of code out; they compare as shipped otherwise.
      problem: why they do not, although they were to; empty otherwise.
      detected: share called slower.
      wrong: share called faster, or called slower where the two are the same.
      by_code: share called different because of the code; None where more differs than the build,
        or where placements are not averaged.
      by_placement: share called different only as shipped; None likewise.
      measured: median slowdown that trials measured, as a share.
      missed: share called the same although the candidate is slower by the smallest effect that
        matters or more; None where it is not.
      inconclusive: share without a verdict.
      covered: share of intervals that hold the truth; None where its size is unknown.
      error: mean of estimate minus truth; None where its size is unknown.
      launches: mean number of launches that a verdict rests on.
      launch_sd: their standard deviation, of the log ratio; None with one launch each.
    """

    averaged: bool
    problem: str = ""
    trials: int
    detected: float
    wrong: float
    by_code: float | None
    by_placement: float | None
    measured: float
    missed: float | None
    inconclusive: float
    covered: float | None
    error: float | None
    seconds: float
    launches: float
    launch_sd: float | None


# The records of a run file by their `type`.
RECORD_TYPES: Mapping[str, type] = {
    record.record_type: record for record in (TrialRecord, Disturbance)
}
