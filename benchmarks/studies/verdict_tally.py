"""Tally how simulated comparisons end: each scenario alone, and families of comparisons."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.studies import tally_file
from benchmarks.studies.simulated_launches import (
    Outcomes,
    Scenario,
    mixed,
    simulate,
    skewed,
    skewed_alike,
    two_modes,
)
from mjbench.measuring import launch_stats
from mjbench.paired.memory_layout import RANDOM_LAUNCHES
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import VerdictPlan

CHANGES = (0.0, 0.005, 0.01, 0.02)
# Comparisons of a family; `mjbench versions` compares ten shipped models.
FAMILY = 10
# The rule by which `mjbench versions` decides a family.
TOGETHER = "e-values of the family"
# Deviation of what the place of code within a page does: it matters by 0.5 to 1 %.
PAGE = 0.007


def _with_placement(scenario: Scenario) -> Scenario:
    return replace(scenario, name=f"{scenario.name}, placed", placed=True)


_AS_SHIPPED = (
    Scenario("normal, 0.3 %", deviation=0.003),
    Scenario("normal, 0.85 %"),
    Scenario("normal, 1.5 %", deviation=0.015),
    Scenario("two modes, ±0.8 %", deviation=0.008, noise=two_modes),
    Scenario("skewed, 0.85 %", noise=skewed),
    Scenario("10 % disturbed", disturbed=0.1),
    Scenario("at most 8 launches", most=8),
    Scenario("at most 16 launches", most=16),
    Scenario("at most 32 launches", most=32),
    Scenario("correlated by 0.2", correlation=0.2),
    Scenario("correlated by 0.5", correlation=0.5),
    Scenario("of one program, by 0.1", shared=0.1),
    Scenario("in pairs, by 0.3", shared=0.3, launches_of_program=RANDOM_LAUNCHES),
)
_PAGE = Scenario("within a page 0.7 %, placed", placed=True, page_deviation=PAGE)
_COMBINED = Scenario(
    "all kinds of noise, placed", noise=mixed, disturbed=0.1, placed=True, page_deviation=PAGE
)
SCENARIOS = (
    *_AS_SHIPPED,
    *map(_with_placement, _AS_SHIPPED),
    _PAGE,
    _COMBINED,
    replace(_COMBINED, name="all kinds of noise, correlated by 0.5, placed", correlation=0.5),
    Scenario("skewed alike, 1.5 %", noise=skewed_alike, deviation=0.015),
    Scenario("skewed, 1.5 %", noise=skewed, deviation=0.015),
)


@dataclass(frozen=True)
class ScenarioRow:
    """How comparisons of one scenario and change ended; shares are of all comparisons.

    Attributes:
      change: the true change, such as 0.01.
      launches: mean number.
      bias: mean of estimated minus true log ratio.
      covered: share whose interval contains the truth.
    """

    scenario: str
    change: float
    slower: float
    faster: float
    same: float
    inconclusive: float
    launches: float
    bias: float
    covered: float

    @classmethod
    def of(cls, scenario: str, change: float, outcomes: Outcomes) -> "ScenarioRow":
        """Return the row of simulated comparisons."""
        return cls(
            scenario,
            change,
            slower=outcomes.share(Verdict.SLOWER),
            faster=outcomes.share(Verdict.FASTER),
            same=outcomes.share(Verdict.SAME),
            inconclusive=outcomes.share(Verdict.INCONCLUSIVE),
            launches=float(outcomes.launches.mean()),
            bias=float(outcomes.errors.mean()),
            covered=float(outcomes.covered.mean()),
        )


@dataclass(frozen=True)
class FamilyRow:
    """How often a family of comparisons, of which one is slower, fails the gate.

    Attributes:
      change: of the one that is slower; 0 if none is.
      rule: how certain each comparison must be.
      failed: share of the families in which one or more are called slower.
      wrong: share in which one or more are that do not differ.
      launches: mean number of launches per comparison that does not differ.
      launches_changed: the same per comparison that does.
    """

    scenario: str
    change: float
    rule: str
    failed: float
    wrong: float
    launches: float
    launches_changed: float


def scenario_rows(scenarios: Sequence[Scenario], comparisons: int) -> Iterator[ScenarioRow]:
    """Simulate each scenario with each change."""
    for scenario in scenarios:
        for change in CHANGES:
            outcomes = simulate(scenario, change, comparisons)
            yield ScenarioRow.of(scenario.name, change, outcomes)


def family_rows(comparisons: int) -> Iterator[FamilyRow]:
    """Simulate families in which none or one of FAMILY comparisons is slower."""
    level = 1 - VerdictPlan().confidence
    rules = (
        ("each verdict alone", VerdictPlan(), 1),
        (TOGETHER, VerdictPlan(), FAMILY),
        ("confidence of 99.9 %", VerdictPlan(confidence=1 - level / FAMILY), 1),
    )
    for scenario in (_with_placement(Scenario("normal, 0.85 %")), _COMBINED):
        for rule, plan, family in rules:
            unchanged = simulate(scenario, 0.0, FAMILY * comparisons, plan, family)
            for change in CHANGES:
                changed = simulate(scenario, change, comparisons, plan, family, seed=1)
                slower = _slower(unchanged, changed, level if family > 1 else None)
                yield FamilyRow(
                    scenario.name,
                    change,
                    rule,
                    failed=float(slower.any(axis=1).mean()),
                    wrong=float(slower[:, 1 if change else 0 :].any(axis=1).mean()),
                    launches=float(unchanged.launches.mean()),
                    launches_changed=float(changed.launches.mean()),
                )


def _slower(unchanged: Outcomes, changed: Outcomes, level: float | None) -> np.ndarray:
    """Return which comparisons are called slower, of shape (families, FAMILY).

    Args:
      unchanged: FAMILY comparisons of each family, of which the first is replaced.
      changed: the first comparison of each family.
      level: of the family; None if each verdict stands alone.
    """
    shape = (-1, FAMILY)
    is_slower: np.ndarray = (unchanged.verdicts == Verdict.SLOWER).reshape(shape)
    is_slower[:, 0] = changed.verdicts == Verdict.SLOWER
    if level is None:
        return is_slower
    e_values = unchanged.e_slower.reshape(shape).copy()
    e_values[:, 0] = changed.e_slower
    rejected = [launch_stats.e_benjamini_hochberg(family, level) for family in e_values.tolist()]
    is_slower &= np.array(rejected)
    return is_slower


@dataclass(frozen=True)
class VerdictTally:
    """How simulated comparisons ended."""

    comparisons: int
    scenarios: Sequence[ScenarioRow]
    families: Sequence[FamilyRow]


def load(file: Path) -> VerdictTally:
    return tally_file.load(file, VerdictTally, "simulated verdicts")
