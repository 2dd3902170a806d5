"""How far the time of a step depends on where the machine code lies.

The baseline is a release as shipped, the candidate the same release with its libraries moved. Their
launches cycle over the residues within a cache line, each moved by a random number of lines. What a
benchmark of one build says is uncertain by the spread of these placements.
"""

import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from mjbench.errors import MachineError
from mjbench.instrument import anytime
from mjbench.instrument.bounds import NonNegativeFloat, NonNegativeInt, PositiveInt, Version
from mjbench.instrument.json_form import in_json
from mjbench.instrument.ratio import Ratio
from mjbench.paired import moved_check
from mjbench.paired.ending import ENDING_ERRORS, ending_of
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.protocol import Launch, TargetPair
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.verdict import CONFIDENCE
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.moved_image import ImmovableError
from mjbench.releases.placement import RESIDUES, Placement, PlacementPair
from mjbench.status import FINISHED, Status

# The interval of fewer launches would be too wide to be of use, so a residue has none then.
MIN_LAUNCHES = 9


@dataclass(frozen=True)
class SpreadPlan:
    """How many launches a model gets.

    Attributes:
      launches: of each residue.
      time_limit_s: seconds from when the model is loaded, after which no launch begins; see
        `time_limit`.
      sizes: of a run.
    """

    launches: int = 14
    time_limit_s: float = 180.0
    sizes: Sizes = field(default_factory=Sizes)


@dataclass(frozen=True)
class ResidueRow:
    """What the launches of one residue say.

    Attributes:
      residue: bytes modulo 64 by which the code was moved.
      ratio: time of a step at such placements over that of the release as shipped.
      launches: how many.
    """

    residue: NonNegativeInt
    ratio: Ratio
    launches: PositiveInt


@dataclass(frozen=True)
class Spread:
    """By how much the slowest residue is slower than the fastest, as a share.

    Attributes:
      estimate: of the residues' estimates.
      low: by how much it is slower at least, if all their intervals hold the truth; 0 where the
        intervals overlap, so that no dependence was seen; None without intervals.
      high: by how much at most.
    """

    estimate: NonNegativeFloat
    low: NonNegativeFloat | None
    high: NonNegativeFloat | None


@in_json(without=["samples"])
@dataclass(frozen=True, kw_only=True)
class SpreadRecord:
    """How far the time of a model's step depends on where the code lies; None is not known.

    Attributes:
      model: its name.
      release: of MuJoCo.
      build: tells builds of one version apart.
      status: how the measurement ended.
      detail: one line; empty when ok, unless time ran out.
      spread: of the residues; None where one of them has no launch.
      residues: those that have launches.
      nbatch: simulations of a run.
      nstep: steps of each.
      launches: in all.
      seconds: from start to end.
      samples: raw times of every launch.
    """

    record_type: ClassVar[str] = "placement"
    model: str
    release: Version
    build: str
    status: Status
    detail: str = ""
    spread: Spread | None = None
    residues: Sequence[ResidueRow] = ()
    nbatch: PositiveInt | None = None
    nstep: PositiveInt | None = None
    launches: NonNegativeInt = 0
    seconds: NonNegativeFloat = 0.0
    samples: Sequence[LaunchRow] = ()


def finished(records: Sequence[object]) -> list[SpreadRecord]:
    """Return the records of a run file that need not be measured again when it is continued."""
    return [r for r in records if isinstance(r, SpreadRecord) and r.status in FINISHED]


def schedule(rng: random.Random) -> Iterator[PlacementPair]:
    """Yield the placements of one launch after the other, endlessly.

    The baseline is as shipped. Of every four launches the candidate takes each residue once.
    """
    while True:
        for residue in rng.sample(RESIDUES, len(RESIDUES)):
            yield PlacementPair(None, Placement.draw(residue, rng))


def residue_rows(launches: Sequence[Launch]) -> list[ResidueRow]:
    """Return what launches say of each residue that they took."""
    log_ratios: dict[int, list[float]] = {}
    for launch in launches:
        if launch.placements.new is not None:
            log_ratios.setdefault(launch.placements.new.residue, []).append(launch.log_ratio)
    return [_residue_row(residue, log_ratios[residue]) for residue in sorted(log_ratios)]


def _residue_row(residue: int, log_ratios: Sequence[float]) -> ResidueRow:
    interval = anytime.anytime_interval(log_ratios, CONFIDENCE)
    estimate, low, high = np.exp([interval.mean, interval.low, interval.high]).tolist()
    has_interval = interval.count >= MIN_LAUNCHES
    ratio = Ratio(estimate, low, high) if has_interval else Ratio(estimate, None, None)
    return ResidueRow(residue, ratio, len(log_ratios))


def spread_of(residues: Sequence[ResidueRow]) -> Spread | None:
    """Return the spread of residues; None unless all are there."""
    if len(residues) < len(RESIDUES):
        return None
    ratios = [row.ratio for row in residues]
    estimates = [ratio.estimate for ratio in ratios]
    estimate = max(estimates) / min(estimates) - 1
    lows = [ratio.low for ratio in ratios if ratio.low is not None]
    highs = [ratio.high for ratio in ratios if ratio.high is not None]
    if len(lows) < len(ratios) or len(highs) < len(ratios):
        return Spread(estimate, None, None)
    return Spread(estimate, max(0.0, max(lows) / min(highs) - 1), max(highs) / min(lows) - 1)


def measure(
    pool: WorkerPool,
    target: Target,
    plan: SpreadPlan,
    on_launch: Callable[[int], None] = lambda count: None,
    clock: Callable[[], float] = time.monotonic,
) -> SpreadRecord:
    """Compare a release with itself moved, until every residue has its launches or time is up.

    Where it crashes, hangs or fails, or Ctrl-C is pressed, the record says so, and holds what was
    measured until then.

    Args:
      pool: starts the processes.
      target: the release, and the model to step.
      plan: how many launches, and for how long.
      on_launch: called after each launch, with their number so far.
      clock: returns seconds.
    """
    begin_s = clock()
    launches: list[Launch] = []
    pair: TargetPair | None = None
    status, detail = Status.OK, ""
    try:
        _check_movable(pool, target)
        needed = min(MIN_LAUNCHES, plan.launches) * len(RESIDUES)
        time_limit = TimeLimit(plan.time_limit_s, needed, clock, "a spread")
        placements = schedule(random.Random())
        pair = TargetPair(pool, target, target, plan.sizes, time_limit, placements)
        detail = launch_all(pair.launch, plan, time_limit, launches, on_launch)
    except ENDING_ERRORS as error:
        ending = ending_of(error)
        status, detail = ending.status, ending.detail
    finally:
        if pair is not None:
            pair.close()
    work_check = pair.work_check if pair else None
    return _record(target, status, detail, work_check, launches, clock() - begin_s)


def launch_all(
    launch: Callable[[], Launch],
    plan: SpreadPlan,
    time_limit: TimeLimit,
    launches: list[Launch],
    on_launch: Callable[[int], None],
) -> str:
    """Add launches to a list until every residue has its number, or time is up.

    Args:
      launch: measures once.
      plan: how many.
      time_limit: that has been started.
      launches: those so far.
      on_launch: called after each launch, with their number so far.

    Returns:
      That time is up; empty where every residue has its launches.

    Raises:
      OutOfTimeError: time is up, and a residue has too few launches for an interval.
    """
    before_s, most = time_limit.spent_s(), plan.launches * len(RESIDUES)
    while True:
        launches.append(launch())
        on_launch(len(launches))
        if len(launches) >= most:
            return ""
        has_intervals = len(launches) >= MIN_LAUNCHES * len(RESIDUES)
        if not time_limit.allows_another(len(launches), before_s, has_intervals):
            return f"time ran out after {len(launches)} of {most} launches"


def _check_movable(pool: WorkerPool, target: Target) -> None:
    """Raise a MachineError where a release cannot be moved here."""
    try:
        moved_check.check(pool, target.release)
    except ImmovableError as error:
        raise MachineError(f"its code cannot be moved: {error}") from error


def _record(
    target: Target,
    status: Status,
    detail: str,
    work_check: WorkCheck | None,
    launches: Sequence[Launch],
    seconds: float,
) -> SpreadRecord:
    residues = residue_rows(launches)
    return SpreadRecord(
        model=target.model.name,
        release=target.release.version,
        build=target.release.key,
        status=status,
        detail=detail,
        spread=spread_of(residues),
        residues=residues,
        nbatch=work_check.nbatch if work_check else None,
        nstep=work_check.nstep if work_check else None,
        launches=len(launches),
        seconds=seconds,
        samples=[launch.row() for launch in launches],
    )
