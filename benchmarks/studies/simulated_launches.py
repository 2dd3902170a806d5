"""Comparisons whose truth is known: launches drawn at random, judged as `mjbench` judges them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjbench.interval import Interval
from mjbench.measuring import launch_stats
from mjbench.measuring.launch_stats import Evidence
from mjbench.paired.memory_layout import FIXED_LAUNCHES
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import MIN_LAUNCHES, VerdictPlan, conclude

# A launch takes about half a second, more where the machine is busy; the default time limit of a
# minute allows as many or more.
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
    drawn: np.ndarray = (skewed(rng, shape) - skewed(rng, shape)) / np.sqrt(2)
    return drawn


def mixed(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw the sum of a normal, a two-modal and a skewed distribution, of deviation 1."""
    total = normal(rng, shape) + two_modes(rng, shape) + skewed(rng, shape)
    drawn: np.ndarray = total / np.sqrt(3)
    return drawn


@dataclass(frozen=True)
class Scenario:
    """How launches of a comparison are drawn.

    Attributes:
      deviation: of a launch's log ratio.
      noise: draws launches of deviation 1.
      correlation: of each launch with the one before.
      shared: correlation of launches whose processes are forked from one program.
      launches_of_program: number of launches in a row from one program.
      disturbed: share of the launches that are off by DISTURBANCE deviations, to either side.
      placed: whether launches move the libraries.
      page_deviation: of what the place within a page does to one side, drawn anew for each launch.
      most: launches after which the time limit ends a comparison.
    """

    name: str
    deviation: float = 0.0085
    noise: Noise = normal
    correlation: float = 0.0
    shared: float = 0.0
    launches_of_program: int = FIXED_LAUNCHES
    disturbed: float = 0.0
    placed: bool = False
    page_deviation: float = 0.0
    most: int = MOST_LAUNCHES


@dataclass(frozen=True)
class Outcomes:
    """How simulated comparisons ended; arrays, one entry for each comparison.

    Attributes:
      verdicts: a `Verdict` each.
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
      change: the true change of time, such as 0.01.
      plan: how certain a verdict must be; the defaults, if None.
      family: number of comparisons that are decided together, see `verdict.judge`.
    """
    plan = replace(plan or VerdictPlan(), family=family)
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
        judgements = [conclude(evidence, plan) for evidence in judged]
        ended = np.array([j.enough for j in judgements]) | (length == scenario.most)
        for number in np.flatnonzero(ended).tolist():
            i, interval = active[number], judged[number].interval
            verdicts[i] = judgements[number].verdict
            errors[i] = interval.estimate - truth
            covered[i] = interval.covers(truth)
            e_slower[i] = judgements[number].e_slower
        lengths[active[ended]] = length
        active = active[~ended]
        if not active.size:
            break
    return Outcomes(verdicts, lengths, errors, covered, e_slower)


def _evidence(cells: np.ndarray, confidence: float, length: int) -> Sequence[Evidence]:
    """Return what launches show, for each comparison."""
    fitted = launch_stats.fit(cells)
    columns = (fitted.mean, fitted.half_width(confidence), *fitted.e_values())
    return [
        Evidence(Interval.around(mean, half_width), length, above, below)
        for mean, half_width, above, below in zip(*map(np.ndarray.tolist, columns), strict=True)
    ]


@dataclass(frozen=True)
class _Launches:
    """Launches of many comparisons, without the true change.

    Attributes:
      log_ratios: of shape (comparisons, launches).
      residues: index of each launch's residue, of the same shape; None where libraries stay.
    """

    log_ratios: np.ndarray
    residues: np.ndarray | None

    @classmethod
    def draw(cls, rng: np.random.Generator, scenario: Scenario, count: int) -> "_Launches":
        noise = _noise(rng, scenario, (count, scenario.most))
        if not scenario.placed:
            return cls(noise, None)
        blocks = -(-scenario.most // len(BASELINE_EFFECTS))
        order = np.tile(np.arange(len(BASELINE_EFFECTS)), (count, blocks, 1))
        residues = rng.permuted(order, axis=2).reshape(count, -1)[:, : scenario.most]
        candidate = rng.permuted(np.tile(BASELINE_EFFECTS, (count, 1)), axis=1)
        effects = (candidate - candidate.mean(axis=1, keepdims=True)) - (
            BASELINE_EFFECTS - BASELINE_EFFECTS.mean()
        )
        page = rng.standard_normal(noise.shape) - rng.standard_normal(noise.shape)
        noise = noise + np.take_along_axis(effects, residues, axis=1)
        return cls(noise + scenario.page_deviation * page, residues)

    def cells(self, comparisons: np.ndarray, truth: float, length: int) -> np.ndarray:
        """Return the first launches of some comparisons as `launch_stats.fit` takes them."""
        values = self.log_ratios[comparisons, :length] + truth
        if self.residues is None:
            return values[:, None, :]
        residues = self.residues[comparisons, :length]
        is_of = residues[:, None, :] == np.arange(len(BASELINE_EFFECTS))[None, :, None]
        return np.where(is_of, values[:, None, :], np.nan)


def _noise(rng: np.random.Generator, scenario: Scenario, size: tuple[int, int]) -> np.ndarray:
    noise = scenario.noise(rng, size)
    if scenario.correlation:
        fresh = np.sqrt(1 - scenario.correlation**2)
        for i in range(1, size[1]):
            noise[:, i] = scenario.correlation * noise[:, i - 1] + fresh * noise[:, i]
    if scenario.shared:
        launches = scenario.launches_of_program
        programs = scenario.noise(rng, (size[0], -(-size[1] // launches)))
        of_program = np.repeat(programs, launches, axis=1)[:, : size[1]]
        noise = np.sqrt(1 - scenario.shared) * noise + np.sqrt(scenario.shared) * of_program
    is_disturbed = rng.random(size) < scenario.disturbed
    noise = noise + np.where(is_disturbed, DISTURBANCE * rng.choice([-1.0, 1.0], size), 0.0)
    return scenario.deviation * noise
