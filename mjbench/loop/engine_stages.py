"""The stages of a step, by the engine's own timers."""

from collections.abc import Mapping

# Stages by MuJoCo's timers (mjtTimer); what they leave of a step is `other`.
STAGES: Mapping[str, str] = {
    "kinematics": "POS_KINEMATICS",
    "inertia": "POS_INERTIA",
    "broad-phase collision": "COL_BROAD",
    "narrow-phase collision": "COL_NARROW",
    "collision": "POS_COLLISION",
    "constraint making": "POS_MAKE",
    "constraint projection": "POS_PROJECT",
    "velocity": "VELOCITY",
    "actuation": "ACTUATION",
    "constraint solver": "CONSTRAINT",
    "integration": "ADVANCE",
}
# What the timers leave of a step.
OTHER = "other"
# The timers that `shares` reads.
TIMERS = (*STAGES.values(), "STEP")


def shares(timer_s: Mapping[str, float]) -> dict[str, float]:
    """Return the share of a step by stage, `other` included; they sum to 1.

    Args:
      timer_s: seconds by timer, without the `mjTIMER_` of its name; a timer that a release does not
        have may be missing.
    """
    stages = {stage: timer_s.get(timer, 0.0) for stage, timer in STAGES.items()}
    # The timer of collision includes its two phases: leave what they do not explain.
    phases = stages["broad-phase collision"] + stages["narrow-phase collision"]
    stages["collision"] = max(0.0, stages["collision"] - phases)
    total = max(timer_s.get("STEP", 0.0), sum(stages.values()), 1e-30)  # never 0, as it divides
    stages[OTHER] = total - sum(stages.values())
    return {stage: value / total for stage, value in stages.items()}
