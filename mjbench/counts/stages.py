"""Divide the engine's instructions by stage of MuJoCo's pipeline."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping

from mjbench.counts.callgrind import CallgrindProfile

# The function whose inclusive cost is the engine's.
ENGINE = "mj_step"
# Functions that only call the stages; the functions that they call are assigned to stages.
TRUNK = (
    "mj_step",
    "mj_forward",
    "mj_forwardSkip",
    "mj_fwdKinematics",
    "mj_fwdPosition",
    "mj_fwdVelocity",
    "mj_RungeKutta",
)
# The functions of each stage; the first pattern that matches decides. Releases name the same
# function with and without `mj_`, and some put it into a further one of its name and `Stage`.
STAGES: Mapping[str, str] = {
    stage: rf"(mj_)?({names})(Stage)?$"
    for stage, names in {
        "kinematics": r"kinematics\w*|comPos|camlight|flex\w*|tendon|transmission|updateSleep\w*|"
        r"wake\w*",
        "inertia": r"crb\w*|makeM|factorM|factorI|tendonArmature",
        "collision": r"collision|broadphase",
        "constraint making": r"makeConstraint|projectConstraint|referenceConstraint|island|"
        r"instantiate\w*|makeImpulse|constructIsland\w*|eff\w+",
        "velocity and forces": r"comVel|passive|rne\w*|fwdActuation|fwdAcceleration|subtreeVel|"
        r"tendonBias|tendonDot|xfrcAccumulate|actuator\w*|fwdVelocity|velocityConstraint|"
        # what the compiler leaves of fwdAcceleration and fwdVelocity where it inlines them
        r"solveM|solveLD|mju_mulMatVec\w*",
        "solver": r"fwdConstraint|solPGS|solCG|solNewton|solNoSlip|solPrimal",
        "sensors": r"sensor\w+|energy\w+",
        "integration": r"Euler\w*|implicit\w*|advance|discrete\w*",
        "checks": r"check\w+",
    }.items()
}


def instructions_by_stage(profile: CallgrindProfile) -> dict[str, int]:
    """Return the engine's instructions by stage; `other` is the rest, so that they sum to all."""
    costs = dict.fromkeys(STAGES, 0)
    trunk = _trunk(profile.arcs)
    for (caller, callee), cost in profile.arcs.items():
        if caller in trunk and callee not in trunk:
            stage = stage_of(callee)
            if stage is not None:
                costs[stage] += cost
    costs["other"] = profile.inclusive_cost[ENGINE] - sum(costs.values())
    return costs


def stage_of(function: str) -> str | None:
    return next((s for s, pattern in STAGES.items() if re.match(pattern, function)), None)


def _trunk(arcs: Iterable[tuple[str, str]]) -> set[str]:
    """Return the functions that only call stages.

    These are the known ones, and those of no stage that nothing but these call: a release may put
    a new function between a known one and its stages.
    """
    callers: dict[str, set[str]] = defaultdict(set)
    for caller, callee in arcs:
        callers[callee].add(caller)
    trunk = set(TRUNK)
    while between := {
        name
        for name, its_callers in callers.items()
        if name not in trunk and stage_of(name) is None and its_callers <= trunk
    }:
        trunk |= between
    return trunk
