"""Histories whose truth is known: log ratios of releases, drawn at random."""

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.history import change_points
from benchmarks.history.change_points import Changes

RELEASES = 42
NO_CHANGE = Path(__file__).parents[2] / "results/history-checks/reference-builds-alike.jsonl"
# A drift lasts as many releases.
_DRIFTING = 20


@dataclass(frozen=True)
class Plan:
    """How the log ratios of a model are drawn.

    Attributes:
      changes: number of change points.
      smallest: size of the smallest, as a share.
      largest: size of the largest.
      deviation: of a release's log ratio, which is also what is known of it; None draws noise from
        the no-change pairs instead.
      drift: change of each release to the next, over _DRIFTING of them.
      outliers: share of the releases that are off by a deviation of 1 %, without a known reason.
      understated: how many times larger the deviation is than is known.
    """

    name: str
    changes: int = 3
    smallest: float = 0.01
    largest: float = 0.05
    deviation: float | None = None
    drift: float = 0.0
    outliers: float = 0.0
    understated: float = 1.0


@dataclass(frozen=True, eq=False)
class SimulatedHistory:
    """A model's log ratios, and what is true of them.

    Attributes:
      log_ratios: (RELEASES,) measured.
      deviations: (RELEASES,) known standard errors.
      changes: of the log ratio, by the index of the first release after each.
      drift: the indices of the first release of a drift and after its last one; None without one.
    """

    log_ratios: np.ndarray
    deviations: np.ndarray
    changes: dict[int, float]
    drift: tuple[int, int] | None


@dataclass(frozen=True)
class Score:
    """What was detected in many histories.

    Attributes:
      detected: change points that were listed at the very release, in the right direction.
      wrong: change points that were listed and are not true.
      named: drifts that were listed and mostly covered.
    """

    planted: int
    detected: int
    wrong: int
    drifts: int
    named: int
    histories: int

    @property
    def power(self) -> float:
        """Share of the change points that are detected; 0 where there is none."""
        return self.detected / max(1, self.planted)

    @property
    def false_discoveries(self) -> float:
        """Share of the listed change points that are wrong; 0 where none is listed."""
        return self.wrong / max(1, self.wrong + self.detected)


@functools.cache
def no_change_log_ratios(as_shipped: bool = False) -> np.ndarray:
    """Return (n,) measured log ratios between builds whose steps execute equally many instructions.

    Args:
      as_shipped: of the builds as they are, rather than with placement averaged out.
    """
    records = [json.loads(line) for line in NO_CHANGE.read_text(encoding="utf-8").splitlines()]
    trials = [record for record in records if record["type"] == "trial"]
    ratios = [t["placement"]["as_shipped"] if as_shipped else t for t in trials]
    return np.log([ratio["estimate"] for ratio in ratios])


def draw(rng: np.random.Generator, plan: Plan) -> SimulatedHistory:
    """Draw a history."""
    truth = np.zeros(RELEASES)
    changes: dict[int, float] = {}
    while len(changes) < plan.changes:
        index = int(rng.integers(1, RELEASES))
        if all(abs(index - other) >= 2 for other in changes):
            size = rng.uniform(plan.smallest, plan.largest) * rng.choice([-1.0, 1.0])
            changes[index] = float(np.log1p(size))
            truth[index:] += changes[index]
    drift = None
    if plan.drift:
        begin = int(rng.integers(0, RELEASES - _DRIFTING))
        drift = begin, begin + _DRIFTING
        truth += plan.drift * np.clip(np.arange(RELEASES) - begin, 0, _DRIFTING - 1)
    noise, known = _noise(rng, plan)
    is_outlier = rng.random(RELEASES) < plan.outliers
    noise = plan.understated * noise + is_outlier * rng.normal(0.0, 0.01, RELEASES)
    return SimulatedHistory(truth + noise, np.full(RELEASES, known), changes, drift)


def _noise(rng: np.random.Generator, plan: Plan) -> tuple[np.ndarray, float]:
    """Return the errors of the log ratios, and their deviation."""
    if plan.deviation is not None:
        return rng.normal(0.0, plan.deviation, RELEASES), plan.deviation
    pairs = no_change_log_ratios()
    # each release has the noise of its own launches, and a pair that of one comparison
    known = float(np.sqrt(np.mean(pairs**2)))
    return rng.choice(pairs, RELEASES), known


def score(plan: Plan, histories: int, seed: int = 0) -> Score:
    """Return what is detected in a number of histories."""
    rng = np.random.default_rng([seed, *plan.name.encode()])
    planted = detected = wrong = drifts = named = 0
    for _ in range(histories):
        history = draw(rng, plan)
        seen = change_points.changes(history.log_ratios.tolist(), history.deviations.tolist())
        listed = {point.index: point.change for point in seen.change_points}
        right = {i for i, change in history.changes.items() if listed.get(i, 0.0) * change > 0}
        planted += len(history.changes)
        detected += len(right)
        wrong += len(listed.keys() - right)
        drifts += history.drift is not None
        named += _is_named(history, seen)
    return Score(planted, detected, wrong, drifts, named, histories)


def _is_named(history: SimulatedHistory, changes: Changes) -> bool:
    """Return whether the drift of a history is listed, over more than half of its releases."""
    if history.drift is None:
        return False
    begin, end = history.drift
    covered = [min(d.end, end) - max(d.begin, begin) for d in changes.drifts]
    return sum(n for n in covered if n > 0) > (end - begin) / 2


PLANS: Sequence[Plan] = (
    Plan("nothing happens", changes=0),
    Plan("nothing happens, 2 % outliers", changes=0, outliers=0.02),
    Plan("nothing happens, noise understated", changes=0, understated=2.0),
    Plan("changes of 1 to 5 %"),
    Plan("changes of 1 %", smallest=0.01, largest=0.01),
    Plan("changes of 1.5 %", smallest=0.015, largest=0.015),
    Plan("changes of 2 %", smallest=0.02, largest=0.02),
    Plan("changes of 2 %, deviation 0.35 %", smallest=0.02, largest=0.02, deviation=0.0035),
    Plan("changes of 2 %, deviation 0.5 %", smallest=0.02, largest=0.02, deviation=0.005),
    Plan("changes of 1 to 5 %, deviation 1 %", deviation=change_points.SIMULATED_DEVIATION),
    Plan("a drift of 0.2 % a release", changes=0, drift=0.002),
    Plan("a drift of 0.2 %, changes of 2 %", changes=2, smallest=0.02, largest=0.02, drift=0.002),
    Plan("changes of 2 %, 2 % outliers", smallest=0.02, largest=0.02, outliers=0.02),
    Plan("changes of 2 %, noise understated", smallest=0.02, largest=0.02, understated=2.0),
)
