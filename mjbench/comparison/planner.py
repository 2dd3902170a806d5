"""Sampling planners: predictive sampling, MPPI and CEM, over piecewise constant controls.

A planner proposes candidates, sequences of controls around its nominal one. From the costs of their
rollouts it improves its nominal sequence. Each draws from a seeded
generator, so the same costs give the same plan, to the last bit.
"""

import enum
from dataclasses import dataclass

import numpy as np


class Algorithm(enum.StrEnum):
    """How a planner improves its nominal controls."""

    PREDICTIVE_SAMPLING = "predictive-sampling"
    """Take the cheapest candidate (Howell et al. 2022, arXiv:2212.00541)."""
    MPPI = "mppi"
    """Take the mean of all, weighted by exp(-cost / temperature) (Williams et al. 2017,
    arXiv:1707.02342, equation 31)."""
    CEM = "cem"
    """Take the mean of the elites, and their standard deviation as the next noise (Rubinstein 1999,
    doi:10.1023/A:1010091220143)."""


@dataclass(frozen=True)
class PlannerSettings:
    """What a planner does.

    Attributes:
      samples: candidates of a plan, the nominal controls among them.
      knots: controls of a candidate.
      noise: standard deviation of the candidates' noise, as a share of half the control range.
      temperature: of MPPI, as a share of the standard deviation of the candidates' costs.
      elites: share of the candidates that CEM keeps.
    """

    algorithm: Algorithm = Algorithm.MPPI
    samples: int = 64
    knots: int = 10
    noise: float = 0.5
    temperature: float = 0.1
    elites: float = 0.1
    seed: int = 0


class Planner:
    """A planner with its nominal controls.

    Attributes:
      nominal: (knots, nu) controls, the best so far.
    """

    def __init__(
        self, settings: PlannerSettings, start: np.ndarray, low: np.ndarray, high: np.ndarray
    ):
        """Begin at constant controls.

        Args:
          settings: of the planner.
          start: (nu,) controls to begin at.
          low: (nu,) smallest controls.
          high: (nu,) largest controls.
        """
        self._settings, self._low, self._high = settings, low, high
        self._rng = np.random.default_rng(settings.seed)
        self._initial_sd = settings.noise * 0.5 * (high - low)
        self._sd = np.tile(self._initial_sd, (settings.knots, 1))
        self.nominal = np.tile(np.clip(start, low, high), (settings.knots, 1))

    def candidates(self) -> np.ndarray:
        """Return (samples, knots, nu) controls; the first ones are the nominal ones."""
        settings = self._settings
        noise = self._rng.standard_normal((settings.samples, *self.nominal.shape))
        noise[0] = 0.0
        return np.clip(self.nominal + self._sd * noise, self._low, self._high)

    def improve(self, candidates: np.ndarray, costs: np.ndarray) -> None:
        """Improve the nominal controls.

        Args:
          candidates: (samples, knots, nu) that `candidates` returned.
          costs: (samples,) of each; one that is not finite counts as the worst.
        """
        worst = np.max(costs[np.isfinite(costs)], initial=0.0)
        costs = np.where(np.isfinite(costs), costs, worst)
        match self._settings.algorithm:
            case Algorithm.PREDICTIVE_SAMPLING:
                self.nominal = candidates[np.argmin(costs)].copy()
            case Algorithm.MPPI:
                scale = self._settings.temperature * costs.std()
                weights = np.exp(-(costs - costs.min()) / max(float(scale), 1e-12))
                self.nominal = np.tensordot(weights / weights.sum(), candidates, axes=1)
            case Algorithm.CEM:
                count = max(2, round(self._settings.elites * len(costs)))
                elites = candidates[np.argsort(costs, kind="stable")[:count]]
                self.nominal = elites.mean(axis=0)
                # never less than a tenth of the noise it began with, so that it goes on searching
                self._sd = np.maximum(elites.std(axis=0), 0.1 * self._initial_sd)

    def advance(self) -> np.ndarray:
        """Return the (nu,) first control of the plan, and shift the plan by it."""
        control: np.ndarray = self.nominal[0].copy()
        self.nominal = np.vstack([self.nominal[1:], self.nominal[-1:]])
        self._sd = np.vstack([self._sd[1:], self._initial_sd[None]])
        return control
