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

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveInt, Version
from mjbench.errors import MachineError
from mjbench.measuring import launch_stats
from mjbench.measuring.ratio import Ratio
from mjbench.paired import moved_check
from mjbench.paired.outcomes import CONFIDENCE
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.target_pair import TargetPair
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.moved_install import ImmovableError
from mjbench.releases.placement import RESIDUES, Placement, PlacementPair
from mjbench.status import FINISHED, Status
from mjbench.store.json_form import in_json

# The interval of fewer launches would be too wide to be of use, so a residue has none then.
MIN_LAUNCHES = 9


@dataclass(frozen=True)
class SpreadPlan:
    """How many launches each residue gets, within seconds from when the model is loaded."""

    launches: int
    time_limit_s: float
    sizes: Sizes = field(default_factory=Sizes)

    @property
    def most_launches(self) -> int:
        return self.launches * len(RESIDUES)


@dataclass(frozen=True)
class ResidueRow:
    """What the launches of one residue say.

    Attributes:
      residue: bytes modulo 64 by which the code was moved.
      ratio: time of a step at such placements over that of the release as shipped.
    """

    residue: NonNegativeInt
    ratio: Ratio
    launches: PositiveInt


@dataclass(frozen=True)
class Spread:
    """By how much the slowest residue is slower than the fastest, as a share.

    Attributes:
      low: by how much it is slower at least, if all their intervals hold the truth; 0 where the
        intervals overlap, so that no dependence was seen; None without intervals.
    """

    estimate: NonNegativeFloat
    low: NonNegativeFloat | None
    high: NonNegativeFloat | None


@in_json(without=["samples"])
@dataclass(frozen=True, kw_only=True)
class SpreadRecord:
    """How far the time of a model's step depends on where the code lies; None is not known.

    Attributes:
      build: tells builds of one version apart.
      detail: one line; empty when ok, unless time ran out.
      spread: of the residues; None where one of them has no launch.
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


def residue_rows(launches: Sequence[LaunchRow]) -> list[ResidueRow]:
    log_ratios: dict[int, list[float]] = {}
    for launch in launches:
        if launch.placements.new is not None:
            log_ratios.setdefault(launch.placements.new.residue, []).append(launch.log_ratio)
    return [_residue_row(residue, log_ratios[residue]) for residue in sorted(log_ratios)]


def _residue_row(residue: int, log_ratios: Sequence[float]) -> ResidueRow:
    interval = launch_stats.anytime_interval(log_ratios, CONFIDENCE)
    estimate, low, high = np.exp([interval.mean, interval.low, interval.high]).tolist()
    has_interval = interval.count >= MIN_LAUNCHES
    ratio = Ratio(estimate, low, high) if has_interval else Ratio(estimate, None, None)
    return ResidueRow(residue, ratio, len(log_ratios))


def spread_of(residues: Sequence[ResidueRow]) -> Spread | None:
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
    """Compare a release with itself moved, until every residue has its launches or time is up."""
    begin_s = clock()
    limit = TimeLimit(plan.time_limit_s, clock=clock, purpose="a spread")
    with TargetPair(pool, target, target, plan.sizes, limit) as pair:
        try:
            moved_check.check(pool, target.release)
        except ImmovableError as error:
            raise MachineError(f"its code cannot be moved: {error}") from error
        limit.min_launches = min(MIN_LAUNCHES, plan.launches) * len(RESIDUES)
        pair.prepare(schedule(random.Random()))
        while (count := len(pair.launches)) < plan.most_launches:
            # with fewer launches for an answer, a residue has no interval
            if not pair.has_time(has_answer=count >= MIN_LAUNCHES * len(RESIDUES)):
                break
            pair.launch()
            on_launch(count + 1)
    samples, detail = pair.launches, pair.ending.detail
    check = pair.work.work_check if pair.work else None
    if pair.ending.status == Status.OK and not detail and len(samples) < plan.most_launches:
        detail = f"time ran out after {len(samples)} of {plan.most_launches} launches"
    residues = residue_rows(samples)
    return SpreadRecord(
        model=target.model.name,
        release=target.release.version,
        build=target.release.key,
        status=pair.ending.status,
        detail=detail,
        spread=spread_of(residues),
        residues=residues,
        nbatch=check.nbatch if check else None,
        nstep=check.nstep if check else None,
        launches=len(samples),
        seconds=clock() - begin_s,
        samples=samples,
    )
