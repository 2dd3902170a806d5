"""Is an engine that compiles the step, MJX or Warp, right? Its check, and what it must not show.

Its colliders and solvers are not C's algorithms. So where no constraint acts, it is held to
tolerances; where one does, its errors are reported.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mjbench.simulation.trajectory import Contacts


class Precision(StrEnum):
    """The type of floating-point numbers that an engine computes in."""

    FLOAT32 = "float32"
    FLOAT64 = "float64"


# Largest error of a single unconstrained step, relative to the largest entry of a field where that
# exceeds 1, by precision.
UNCONSTRAINED_STEP_LIMIT = {Precision.FLOAT64: 1e-12, Precision.FLOAT32: 1e-4}
# A run in float32 may differ from C by this many times the difference of the shadow (C with float32
# states), or the error of a single unconstrained step if that is larger. The shadow rounds only
# states; an engine in float32 rounds everything that it computes.
SHADOW_FACTOR = 10.0
# Largest difference of an unconstrained run in float64.
UNCONSTRAINED_RUN_LIMIT = 1e-10
# Errors in float32 and float64 that differ by less than this factor are not due to precision.
PRECISION_FACTOR = 10.0
# Impulses of contacts, and violations of constraints, must be of C's order: within this factor of
# C's. Violations may also be this share of the model's mean size (`stat.meansize`).
ORDER = 3.0
VIOLATION_SHARE = 0.1
# A larger error stands for NaN or infinity (see `agreement.max_relative_error`).
FINITE_LIMIT = 1e300


@dataclass(frozen=True, kw_only=True)
class AcceleratedCheck:
    """How far an engine differs from C: in single steps, and over a run.

    Errors and differences are those of `agreement.max_relative_error` over qpos, qvel and act. The
    shadow is the run of C in which states and controls are rounded to float32 before every step.

    Attributes:
      received: whether the engine has exactly the start states and controls that it was given.
      still: whether no single step of the engine changed any state, although C's steps did.
      same_count: share of the steps in contact with as many contacts as in C; None without such
        steps, or where the engine does not report contacts.
      normal_degrees: largest angle between contact normals of the engine and C (see
        `normal_angle`); None under the same conditions.
      contact_impulse: the engine's contact impulse over C's in single steps, the median over steps
        in contact; None without such steps.
      penetration: depth of the deepest contact in m at the end of the run, evaluated by C; None in
        older files.
      penetration_in_c: the same at the end of C's run.
      violation: largest residual of an equality, or excess over a limit, in m or rad at the end of
        the run; None in older files.
      violation_in_c: the same at the end of C's run.
      mean_size: size of the model's parts in m (`stat.meansize`).
      unconstrained_steps: single steps on which no constraint acted.
      constrained_steps: single steps without contact on which a constraint acted.
      unconstrained_error: largest error of an unconstrained single step; None if there was none.
      unconstrained_nstep: steps of the run before the first on which a constraint acted.
      unconstrained_difference: largest difference from C after those steps; `unconstrained_shadow`
        is the shadow's.
      final_difference: largest difference from C at the end of the run; `final_shadow` is the
        shadow's.
      final_shadow_median: the shadow's difference at the end, the median over simulations.
      lost: simulations that do not end in finite numbers.
    """

    precision: Precision
    received: bool
    still: bool
    same_count: float | None = None
    normal_degrees: float | None = None
    contact_impulse: float | None = None
    penetration: float | None = None
    penetration_in_c: float | None = None
    violation: float | None = None
    violation_in_c: float | None = None
    mean_size: float | None = None
    unconstrained_steps: int
    constrained_steps: int
    contact_steps: int
    unconstrained_error: float | None
    constrained_error: float | None
    contact_error: float | None
    unconstrained_nstep: int
    unconstrained_difference: float
    unconstrained_shadow: float
    final_nstep: int
    final_difference: float
    final_shadow: float
    final_shadow_median: float
    lost: int


def failures(check: AcceleratedCheck) -> list[str]:
    """Return what an engine must not do and did, a phrase each; empty if it may be timed."""
    failed = []
    if not check.received:
        failed.append("the engine does not have the start states or controls that it was given")
    failed += _single_step_failures(check)
    if check.still:
        failed.append("no step changes any state")
    allowed = _unconstrained_run_limit(check)
    if check.unconstrained_nstep and not check.unconstrained_difference <= allowed:
        failed.append(
            f"{check.unconstrained_nstep} unconstrained steps differ by"
            f" {check.unconstrained_difference:.2g}, more than {allowed:.2g}"
        )
    if check.lost:
        failed.append(f"{check.lost} simulations do not end in finite numbers")
    return failed + _constraint_failures(check)


def _constraint_failures(check: AcceleratedCheck) -> list[str]:
    """Return in what contacts and constraints are not of C's order, a phrase each."""
    failed = []
    share = check.contact_impulse
    if share is not None and not 1 / ORDER <= share <= ORDER:
        failed.append(f"contacts have {share:.2g} times the impulse that they have in C")
    least = VIOLATION_SHARE * (check.mean_size or 0.0)
    for name, value, in_c in (
        ("penetrate", check.penetration, check.penetration_in_c),
        ("violate constraints", check.violation, check.violation_in_c),
    ):
        if value is not None and in_c is not None and not value <= ORDER * in_c + least:
            failed.append(f"final states {name} by {value:.2g}, those of C by {in_c:.2g}")
    return failed


def _single_step_failures(check: AcceleratedCheck) -> list[str]:
    failed = []
    error, limit = check.unconstrained_error, UNCONSTRAINED_STEP_LIMIT[check.precision]
    if error is not None and not error <= limit:
        failed.append(f"an unconstrained step differs by {error:.2g}, more than {limit:g}")
    if check.constrained_error is not None and check.constrained_error > FINITE_LIMIT:
        failed.append("a constrained step does not end in finite numbers")
    if check.contact_error is not None and check.contact_error > FINITE_LIMIT:
        failed.append("a step in contact does not end in finite numbers")
    return failed


def _unconstrained_run_limit(check: AcceleratedCheck) -> float:
    """Return the largest difference that an unconstrained run may have."""
    if check.precision == Precision.FLOAT64:
        return UNCONSTRAINED_RUN_LIMIT
    rounding = max(check.unconstrained_error or 0.0, float(np.finfo(np.float32).eps))
    return SHADOW_FACTOR * max(check.unconstrained_shadow, rounding)


def summary(check: AcceleratedCheck) -> str:
    """Return the results of a check in one line."""
    steps = (
        (check.unconstrained_steps, "unconstrained", check.unconstrained_error),
        (check.constrained_steps, "constrained", check.constrained_error),
        (check.contact_steps, "in contact", check.contact_error),
    )
    kinds = [f"{count} {kind} within {error:.1g}" for count, kind, error in steps if count]
    parts = [f"single steps: {', '.join(kinds)}"]
    if check.same_count is not None:
        parts.append(f"as many contacts as C in {100 * check.same_count:.0f} % of those")
    if check.normal_degrees is not None:
        parts.append(f"normals within {check.normal_degrees:.2g}°")
    if check.contact_impulse is not None:
        parts.append(f"{check.contact_impulse:.2f} times C's contact impulse")
    parts.append(
        f"after {check.final_nstep} steps a difference of {check.final_difference:.1g}"
        f" (C with float32 states: {check.final_shadow:.1g})"
    )
    return ", ".join(parts)


def error_cause(float32: AcceleratedCheck, float64: AcceleratedCheck) -> str:
    """Return whether an engine's float32 errors are due to its precision or to its algorithm.

    Args:
      float64: in float64, on the same steps as `float32`.
    """
    errors = (
        (float32.contact_error, float64.contact_error),
        (float32.constrained_error, float64.constrained_error),
        (float32.unconstrained_error, float64.unconstrained_error),
    )
    for coarse, fine in errors:
        if coarse is not None and fine is not None:
            if fine * PRECISION_FACTOR < coarse:
                return f"precision: in float64 a step differs by {fine:.1g} instead of {coarse:.1g}"
            return f"algorithm: in float64 a step differs by {fine:.1g}, about as much"
    return "unknown: the two checks took no step of the same kind"


def normal_angle(reference: "Contacts", contacts: "Contacts") -> float | None:
    """Return the largest angle between normals of contacts of the same geoms, in degrees.

    Each contact is compared with the nearest normal of the reference for the same two geoms.

    Args:
      contacts: of the engine, in the same simulations as `reference`.

    Returns:
      The angle; 180 where a normal is not finite; None if no contact has the same geoms in both.
    """
    largest = None
    for simulation in np.unique(contacts.simulation):
        ours = reference.simulation == simulation
        theirs = contacts.simulation == simulation
        for geom, normal in zip(contacts.geom[theirs], contacts.normal[theirs], strict=True):
            same = ours & (reference.geom == geom).all(axis=1)
            if same.any():
                cosine = np.clip((reference.normal[same] @ normal).max(), -1.0, 1.0)
                angle = float(np.degrees(np.arccos(cosine))) if np.isfinite(cosine) else 180.0
                largest = max(largest or 0.0, angle)
    return largest
