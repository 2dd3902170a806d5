"""The rows and records of paired comparisons: what `--json` gives, and what a run file stores.

Field names are the keys of the JSON format (docs/formats.md); there the baseline is `old` and the
candidate `new`, as on the command line.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar

from mjbench.instrument.bounds import (
    LogRatio,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)
from mjbench.paired.outcomes import Metric, Verdict
from mjbench.simulation.starts import Starts
from mjbench.simulation.work import Work
from mjbench.simulation.work_check import RunDrift
from mjbench.status import FINISHED, Status


@dataclass(frozen=True)
class Ratio:
    """Candidate over baseline, with its interval; the ends are None where there is none."""

    estimate: PositiveFloat
    low: PositiveFloat | None
    high: PositiveFloat | None


@dataclass(frozen=True)
class TargetRow:
    """One of the two targets.

    Attributes:
      release: of MuJoCo.
      model: its name.
      path: way of stepping.
      options: of the path.
      model_options: fields of `model.opt` that were set, by name.
      slowdown: injected, as a share of the work; 0 in a real comparison.
      build: tells builds of one version apart; empty where it is unknown.
    """

    release: str
    model: str
    path: str
    options: Mapping[str, Any]
    model_options: Mapping[str, str]
    slowdown: float = 0.0
    build: str = ""


@dataclass(frozen=True)
class WorkPair:
    """Work per step of the baseline and of the candidate."""

    old: Work
    new: Work


@dataclass(frozen=True)
class DivergedPair:
    """Simulations that diverged, of the baseline and of the candidate."""

    old: NonNegativeInt
    new: NonNegativeInt


@dataclass(frozen=True)
class WarningsPair:
    """How many simulations raised each warning, of the baseline and of the candidate."""

    old: Mapping[str, NonNegativeInt]
    new: Mapping[str, NonNegativeInt]


@dataclass(frozen=True, kw_only=True)
class VerdictRow:
    """One paired comparison, as people and programs read it; None is what cannot be said.

    Attributes:
      model: of the candidate.
      path: of the candidate.
      old: MuJoCo release of the baseline.
      new: MuJoCo release of the candidate.
      sides: baseline and candidate.
      metric: what `ratio` compares.
      status: how the comparison ended.
      detail: one line; empty when ok.
      verdict: None where nothing was measured.
      ratio: of time, or of instructions.
      changed_work: whether the two do other work.
      work: contacts, constraints, solver iterations per step.
      drift: largest difference of qpos, qvel and act one step after the same states, at several
        points of the run, relative to each field (see `work_check.StateDrift`).
      run_drift: the same for runs from the same starts, at several points.
      diverged: simulations that diverged; none of them is timed.
      warnings: how many of the others raised each warning of MuJoCo.
      nbatch: simulations of a block.
      nstep: steps of each.
      starts: where start states came from; of the baseline where the two differ in size.
      launches: that the verdict rests on.
      pairs: of blocks, over all launches.
      seconds: from start to verdict.
    """

    model: str
    path: str
    old: str
    new: str
    sides: Sequence[TargetRow]
    metric: Metric = Metric.TIME
    status: Status
    detail: str = ""
    verdict: Verdict | None = None
    ratio: Ratio | None = None
    changed_work: bool | None = None
    work: WorkPair | None = None
    drift: float | None = None
    run_drift: Sequence[RunDrift] = ()
    diverged: DivergedPair | None = None
    warnings: WarningsPair | None = None
    nbatch: PositiveInt | None = None
    nstep: PositiveInt | None = None
    starts: Starts | None = None
    launches: NonNegativeInt = 0
    pairs: NonNegativeInt = 0
    seconds: NonNegativeFloat = 0.0


@dataclass(frozen=True)
class LaunchRow:
    """Raw times of one launch.

    Attributes:
      core: that both targets ran on; None where they used all.
      cores: that as many threads as the targets have got just before; None for one thread.
      orders: of each quad, `ABBA` or `BAAB`; A is the baseline.
      ns: (quads, 4) nanoseconds of each block, in the order they ran.
    """

    core: int | None
    cores: PositiveFloat | None
    orders: Sequence[str]
    ns: Sequence[Sequence[int]]


@dataclass(frozen=True, kw_only=True)
class VerdictRecord(VerdictRow):
    """A verdict as a run file stores it, with the raw times of every launch."""

    record_type: ClassVar[str] = "verdict"
    samples: Sequence[LaunchRow] = ()

    def row(self) -> VerdictRow:
        """Return the verdict without its samples."""
        return VerdictRow(**{f.name: getattr(self, f.name) for f in fields(VerdictRow)})


def finished(records: Sequence[object]) -> list[VerdictRecord]:
    """Return the verdicts of a run file that need not be measured again when it is continued."""
    return [r for r in records if isinstance(r, VerdictRecord) and r.status in FINISHED]


def by_sides(records: Sequence[VerdictRecord]) -> dict[str, VerdictRecord]:
    """Return verdicts by their targets (see `sides_key`)."""
    return {sides_key(record.sides): record for record in records}


def sides_key(sides: Sequence[TargetRow]) -> str:
    """Return a text that names two targets, as they are or as a run file holds them."""
    return repr([asdict(side) for side in sides])


@dataclass(frozen=True)
class TrialRecord:
    """One comparison of `mjbench selfcheck`, whose truth is known.

    Attributes:
      model: its name.
      slowdown: injected, as a share; 0 is an A/A comparison.
      verdict: what was decided.
      estimate: candidate over baseline time.
      low: lower end of its interval; None with too few launches.
      high: upper end of its interval.
      seconds: from start to verdict.
      launches: log ratio of each.
    """

    record_type: ClassVar[str] = "trial"
    model: str
    slowdown: NonNegativeFloat
    verdict: Verdict
    estimate: PositiveFloat
    low: PositiveFloat | None
    high: PositiveFloat | None
    seconds: NonNegativeFloat
    launches: Sequence[LogRatio]


def trial_records(records: Sequence[object]) -> list[TrialRecord]:
    """Return the trials among the records of a run file; each one is finished."""
    return [record for record in records if isinstance(record, TrialRecord)]


@dataclass(frozen=True)
class SelfcheckRow:
    """What the trials of one model and slowdown say.

    Attributes:
      model: its name.
      slowdown: injected, as a share.
      trials: how many.
      detected: share called slower.
      wrong: share called faster, or called slower where nothing was injected.
      missed: share called the same although something was injected.
      inconclusive: share without a verdict.
      covered: share of intervals that hold the truth.
      error: mean of estimate minus truth.
      seconds: mean time of a comparison.
      launches: mean number of launches.
      launch_sd: standard deviation between launches, of the log ratio; None with one launch each.
    """

    model: str
    slowdown: float
    trials: int
    detected: float
    wrong: float
    missed: float
    inconclusive: float
    covered: float
    error: float
    seconds: float
    launches: float
    launch_sd: float | None
