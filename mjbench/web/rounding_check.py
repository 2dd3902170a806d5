"""Does a WebAssembly build do what C does? Its check, and what it must not show.

It is the same engine, compiled for another processor, with another mathematics library. So it may
differ from C by rounding, which contact multiplies. A build may differ by as much as the shadow
does: C itself, moved by one unit in the last place before each step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjbench.bounds import AnyFloat, NonNegativeInt, PositiveInt
from mjbench.simulation import agreement
from mjbench.simulation.rounding_reference import (
    ReferenceRun,
    ReferenceSteps,
    differences,
    largest_so_far,
)

# A run may differ from C by this, and by so many times the shadow's difference if that is more.
RUN_LIMIT, SHADOW_FACTOR = 1e-10, 10.0
# The same for a single step on which no constraint acts, and for one on which a constraint does.
UNCONSTRAINED_STEP_LIMIT, CONSTRAINED_STEP_LIMIT = 1e-12, 1e-9


@dataclass(frozen=True)
class FirstDifference:
    """The first entry of a run that differs from C in any bit.

    Attributes:
      step: number of steps after which it does; 0 is the start itself.
      difference: in SI units; 0 where only the sign of a zero differs.
    """

    step: NonNegativeInt
    field: str
    index: NonNegativeInt
    simulation: NonNegativeInt
    difference: AnyFloat

    def __str__(self) -> str:
        entry = f"{self.field}[{self.index}] of simulation {self.simulation}"
        return f"after step {self.step}, in {entry}, by {self.difference:.1e}"


@dataclass(frozen=True)
class PointDifference:
    """How far a run is from C.

    Attributes:
      difference: the largest up to then, of any simulation (see `rounding_reference.differences`).
    """

    step: NonNegativeInt
    difference: AnyFloat
    shadow: AnyFloat


@dataclass(frozen=True)
class StepErrors:
    """How far single steps are from those of C."""

    count: NonNegativeInt
    error: AnyFloat
    shadow: AnyFloat
    median_error: AnyFloat
    median_shadow: AnyFloat


@dataclass(frozen=True, kw_only=True)
class RoundingCheck:
    """How far a build is from C.

    Attributes:
      first: entry that differs; None where the run is identical to the last bit.
      points: after 0, 1, 10, 100, … steps, and at the end.
      excess: the first step after which the run differs by more than it may; None without one.
      unconstrained_nstep: steps of the run before the first on which a constraint acted.
      unconstrained: single steps on which no constraint acted.
      constrained: the other single steps.
      first_of_same_model: as `first`, of the model that C compiled; None where that run is
        identical.
      has_same_model: whether the model that C compiled was run, too.
    """

    nstep: PositiveInt
    first: FirstDifference | None
    points: Sequence[PointDifference]
    excess: PositiveInt | None
    unconstrained_nstep: NonNegativeInt
    unconstrained: StepErrors
    constrained: StepErrors
    first_of_same_model: FirstDifference | None = None
    has_same_model: bool = False

    def __post_init__(self) -> None:
        if not self.points:
            raise ValueError("points are missing")

    @property
    def final(self) -> PointDifference:
        return self.points[-1]


def check(
    run: ReferenceRun,
    steps: ReferenceSteps,
    states: np.ndarray,
    after: np.ndarray,
    of_same_model: np.ndarray | None,
) -> RoundingCheck:
    """Return how far a build is from C.

    Args:
      states: (nstep + 1, nbatch, nstate) of the build's run.
      after: (n, nstate) to which the build's single steps lead.
      of_same_model: as `states`, of the model that C compiled; None where it was not run.
    """
    difference = largest_so_far(states, run.states, run.columns)
    is_excess = ~(difference <= np.maximum(RUN_LIMIT, SHADOW_FACTOR * run.shadow))
    errors = differences(after, steps.after, run.columns)
    return RoundingCheck(
        nstep=len(states) - 1,
        first=first_difference(states, run),
        points=[
            PointDifference(step, float(difference[step]), float(run.shadow[step]))
            for step in points(len(states) - 1)
        ],
        excess=max(1, int(np.argmax(is_excess))) if is_excess.any() else None,
        unconstrained_nstep=run.unconstrained_nstep,
        unconstrained=_errors(errors, steps, ~steps.is_constrained),
        constrained=_errors(errors, steps, steps.is_constrained),
        first_of_same_model=None if of_same_model is None else first_difference(of_same_model, run),
        has_same_model=of_same_model is not None,
    )


def points(nstep: int) -> list[int]:
    """Return the numbers of steps at which differences are given: 0, 1, 10, …, and the end."""
    powers = [10**i for i in range(len(str(nstep)))]
    return sorted({0, *powers, nstep})


def first_difference(states: np.ndarray, run: ReferenceRun) -> FirstDifference | None:
    """Return the first entry that differs in any bit: the earliest, of the lowest simulation."""
    got, expected = (np.ascontiguousarray(a.swapaxes(0, 1)) for a in (states, run.states))
    entry = agreement.first_differing_step(got, expected, run.columns)
    if entry is None:
        return None
    assert entry.step is not None, "steps were compared"
    difference = float(np.nan_to_num(abs(entry.got - entry.expected), nan=np.inf, posinf=np.inf))
    step = entry.step - 1  # counted from 1, and row 0 is the start
    return FirstDifference(step, entry.field, entry.index, entry.simulation, min(difference, 1e12))


def failures(check: RoundingCheck) -> list[str]:
    """Return what a build must not do and did, a phrase each; empty if it may be timed."""
    failed = []
    if check.first is not None and check.first.step == 0:
        failed.append(f"it does not start where C does ({check.first})")
    for kind, errors, least in (
        ("an unconstrained", check.unconstrained, UNCONSTRAINED_STEP_LIMIT),
        ("a constrained", check.constrained, CONSTRAINED_STEP_LIMIT),
    ):
        for which, error, shadow in (
            ("", errors.error, errors.shadow),
            (" in the median", errors.median_error, errors.median_shadow),
        ):
            allowed = max(least, SHADOW_FACTOR * shadow)
            if not error <= allowed:
                failed.append(f"{kind} step differs by {error:.1e}{which}, more than {allowed:.1e}")
                break
    if check.excess is not None:
        failed.append(
            f"from step {check.excess} on, the run differs by more than {SHADOW_FACTOR:g} times"
            f" the shadow ({check.final.difference:.1e} after {check.nstep} steps, the shadow by"
            f" {check.final.shadow:.1e})"
        )
    return failed


def _errors(errors: np.ndarray, steps: ReferenceSteps, which: np.ndarray) -> StepErrors:
    if not which.any():
        return StepErrors(0, 0.0, 0.0, 0.0, 0.0)
    error, shadow = errors[which], steps.shadow[which]
    return StepErrors(
        int(which.sum()),
        float(error.max()),
        float(shadow.max()),
        float(np.median(error)),
        float(np.median(shadow)),
    )
