"""Divide the engine's instructions by stage of MuJoCo's pipeline."""

import re
from collections.abc import Mapping

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
# The functions of each stage; the first pattern that matches decides.
STAGES: Mapping[str, str] = {
    "kinematics": r"mj_(kinematics\w*|comPos|camlight|flex|tendon|transmission|updateSleep\w*)$",
    "inertia": r"mj_(crb|makeM|factorM|factorI|tendonArmature)$",
    "collision": r"mj_(collision|broadphase)$",
    "constraint making": r"mj_(makeConstraint|projectConstraint|referenceConstraint|island|"
    r"instantiate\w*|makeImpulse|constructIsland\w*)$",
    "velocity and forces": r"mj_(comVel|passive|rne\w*|fwdActuation|fwdAcceleration|subtreeVel|"
    r"tendonBias|tendonDot|xfrcAccumulate|actuator\w*|fwdVelocity)$",
    "solver": r"mj_(fwdConstraint|solPGS|solCG|solNewton|solNoSlip)$",
    "sensors": r"mj_(sensor\w+|energy\w+)$",
    "integration": r"mj_(Euler\w*|implicit\w*|advance|discrete\w*)$",
    "checks": r"mj_(check\w+)$",
}


def instructions_by_stage(profile: CallgrindProfile) -> dict[str, int]:
    """Return the engine's instructions by stage; `other` is the rest, so that they sum to all."""
    costs = dict.fromkeys(STAGES, 0)
    for (caller, callee), cost in profile.arcs.items():
        if caller in TRUNK and callee not in TRUNK:
            stage = next((s for s, pattern in STAGES.items() if re.match(pattern, callee)), None)
            if stage is not None:
                costs[stage] += cost
    costs["other"] = profile.inclusive(ENGINE) - sum(costs.values())
    return costs
