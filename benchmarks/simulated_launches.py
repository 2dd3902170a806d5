"""Comparisons whose truth is known: launches drawn at random, judged as `mjbench` judges them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mjbench.instrument.placements import RESIDUES

from mjbench.instrument import anytime
from mjbench.instrument.anytime import Evidence, Interval
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import MIN_LAUNCHES, VerdictPlan, conclude

# A launch takes about 0.7 s; as many as the default time limit of a minute allows.
MOST_LAUNCHES = 80
# How much slower than on average code is at each residue. The baseline's are measured (pile,
# MuJoCo 3.2.1); the candidate's are as large, and in another order for each comparison.
BASELINE_EFFECTS = np.array([0.0, -0.011, -0.048, 0.016])
# A disturbed launch is off by this many deviations.
DISTURBANCE = 10.0

Noise = Callable[[np.random.Generator, tuple[int, int]], np.ndarray]


def normal(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw from a normal distribution of deviation 1."""
    return rng.standard_normal(shape)


def two_modes(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw 1 or -1, with a deviation of 0.1 around them."""
    return rng.choice([-1.0, 1.0], shape) + 0.1 * rng.standard_normal(shape)


def skewed(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw from an exponential distribution of deviation 1, moved to a mean of 0."""
    return rng.standard_exponential(shape) - 1


def skewed_alike(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw the difference of two exponential distributions, of deviation 1."""
    return (skewed(rng, shape) - skewed(rng, shape)) / np.sqrt(2)


def mixed(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw the sum of a normal, a two-modal and a skewed distribution, of deviation 1."""
    return (normal(rng, shape) + two_modes(rng, shape) + skewed(rng, shape)) / np.sqrt(3)


@dataclass(frozen=True)
class Scenario:
    """How launches of a comparison are drawn.

    Attributes:
      name: for the table.
      deviation: of a launch's log ratio.
      noise: draws launches of deviation 1.
      correlation: of each launch with the one before.
      disturbed: share of the launches that are off by DISTURBANCE deviations, to either side.
      placed: whether launches move the libraries.
      images: number of images of each residue.
      image_deviation: of an image's effect on one side, drawn anew for each comparison.
      most: launches after which the time limit ends a comparison.
    """

    name: str
    deviation: float = 0.0085
    noise: Noise = normal
    correlation: float = 0.0
    disturbed: float = 0.0
    placed: bool = False
    images: int = 16
    image_deviation: float = 0.0
    most: int = MOST_LAUNCHES


@dataclass(frozen=True)
class Outcomes:
    """How simulated comparisons ended; arrays, one entry for each comparison.

    Attributes:
      verdicts: a `Verdict` each.
      launches: number of launches.
      errors: estimated minus true log ratio.
      covered: whether the interval contains the true log ratio.
      e_slower: e-values against "not slower".
    """

    verdicts: np.ndarray
    launches: np.ndarray
    errors: np.ndarray
    covered: np.ndarray
    e_slower: np.ndarray

    def share(self, *verdicts: Verdict) -> float:
        """Return the share of comparisons with one of the verdicts."""
        return float(np.isin(self.verdicts, verdicts).mean())


def simulate(
    scenario: Scenario,
    change: float,
    count: int,
    plan: VerdictPlan | None = None,
    family: int = 1,
    seed: int = 0,
) -> Outcomes:
    """Launch until there are enough launches, judging after each, in many comparisons.

    Args:
      scenario: how launches are drawn.
      change: the true change of time, such as 0.01.
      count: number of comparisons.
      plan: how certain a verdict must be; the defaults, if None.
      family: number of comparisons that are decided together, see `verdict.judge`.
      seed: of the random numbers.
    """
    plan = plan or VerdictPlan()
    rng = np.random.default_rng([seed, round(1e5 * (1 + change))])
    truth = float(np.log1p(change))
    launches = _Launches.draw(rng, scenario, count)
    active = np.arange(count)
    verdicts = np.full(count, Verdict.INCONCLUSIVE, dtype=object)
    lengths = np.full(count, scenario.most)
    errors, e_slower = np.zeros(count), np.ones(count)
    covered = np.zeros(count, dtype=bool)
    for length in range(MIN_LAUNCHES, scenario.most + 1):
        judged = _evidence(launches.cells(active, truth, length), plan.confidence, length)
        judgements = [
            conclude(e, plan.min_effect, plan.confidence, plan.precision, family) for e in judged
        ]
        ended = np.array([j.enough for j in judgements]) | (length == scenario.most)
        for number in np.flatnonzero(ended):
            i, interval = active[number], judged[number].interval
            verdicts[i] = judgements[number].verdict
            errors[i] = interval.mean - truth
            covered[i] = interval.low <= truth <= interval.high
            e_slower[i] = judgements[number].e_slower
        lengths[active[ended]] = length
        active = active[~ended]
        if not active.size:
            break
    return Outcomes(verdicts, lengths, errors, covered, e_slower)


def _evidence(cells: np.ndarray, confidence: float, length: int) -> Sequence[Evidence]:
    """Return what launches show, for each comparison."""
    fitted = anytime.fit(cells)
    columns = (fitted.mean, fitted.half_width(confidence), *fitted.e_values())
    return [
        Evidence(Interval(mean, mean - half_width, mean + half_width, length), above, below)
        for mean, half_width, above, below in zip(*map(np.ndarray.tolist, columns), strict=True)
    ]


@dataclass(frozen=True)
class _Launches:
    """Launches of many comparisons, without the true change.

    Attributes:
      log_ratios: of shape (comparisons, launches).
      residues: of each launch, of the same shape; zeros where libraries stay where they are.
      images: of each launch, likewise.
      shape: number of residues, and of images of each; (1, 0) where libraries stay.
    """

    log_ratios: np.ndarray
    residues: np.ndarray
    images: np.ndarray
    shape: tuple[int, int]

    @classmethod
    def draw(cls, rng: np.random.Generator, scenario: Scenario, count: int) -> "_Launches":
        size = (count, scenario.most)
        noise = _noise(rng, scenario, size)
        if not scenario.placed:
            zeros = np.zeros(size, dtype=int)
            return cls(noise, zeros, zeros, (1, 0))
        residues, images = _placements(rng, scenario, count)
        moved = rng.permuted(np.tile(BASELINE_EFFECTS, (count, 1)), axis=1)
        effects = (moved - moved.mean(axis=1, keepdims=True)) - (
            BASELINE_EFFECTS - BASELINE_EFFECTS.mean()
        )
        rows = np.arange(count)[:, None]
        shape = (count, RESIDUES, scenario.images)
        sides = rng.standard_normal(shape) - rng.standard_normal(shape)
        noise = noise + effects[rows, residues]
        noise = noise + scenario.image_deviation * sides[rows, residues, images]
        return cls(noise, residues, images, (RESIDUES, scenario.images))

    def cells(self, comparisons: np.ndarray, truth: float, length: int) -> np.ndarray:
        """Return the first launches of some comparisons as `anytime.fit` takes them."""
        values = self.log_ratios[comparisons, :length] + truth
        residues, images = self.shape
        if not images:
            return values[:, None, :]
        sums = np.zeros((len(comparisons), residues, images))
        counts = np.zeros_like(sums)
        rows = np.arange(len(comparisons))[:, None]
        index = (rows, self.residues[comparisons, :length], self.images[comparisons, :length])
        np.add.at(sums, index, values)
        np.add.at(counts, index, 1)
        return np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)


def _noise(rng: np.random.Generator, scenario: Scenario, size: tuple[int, int]) -> np.ndarray:
    noise = scenario.noise(rng, size)
    if scenario.correlation:
        fresh = np.sqrt(1 - scenario.correlation**2)
        for i in range(1, size[1]):
            noise[:, i] = scenario.correlation * noise[:, i - 1] + fresh * noise[:, i]
    is_disturbed = rng.random(size) < scenario.disturbed
    noise = noise + np.where(is_disturbed, DISTURBANCE * rng.choice([-1.0, 1.0], size), 0.0)
    return scenario.deviation * noise


def _placements(
    rng: np.random.Generator, scenario: Scenario, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return residue and image of each launch, drawn as `placements.design` draws them."""
    blocks = -(-scenario.most // RESIDUES)
    cycles = -(-blocks // scenario.images)
    orders = np.tile(np.arange(scenario.images), (count, RESIDUES, cycles, 1))
    orders = rng.permuted(orders, axis=3).reshape(count, RESIDUES, -1)
    residues = rng.permuted(np.tile(np.arange(RESIDUES), (count, blocks, 1)), axis=2)
    block = np.arange(blocks)[None, :, None]
    images = orders[np.arange(count)[:, None, None], residues, block]
    return tuple(a.reshape(count, -1)[:, : scenario.most] for a in (residues, images))
