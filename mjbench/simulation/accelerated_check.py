"""placeholder until merged"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class AcceleratedCheck:
    """How far an accelerated engine is from C."""

    precision: str
    received: bool
    still: bool
    same_count: float | None = None
    normal_degrees: float | None = None
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
    return []


def summary(check: AcceleratedCheck) -> str:
    return ""


def normal_angle(a, b) -> float | None:
    return None
