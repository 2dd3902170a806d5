"""The asv benchmarks of benchmarks/ that are used by name.

A name is MODULE.CLASS.METHOD below benchmarks/, as asv stores it in results/asv/benchmarks.json.
"""

from enum import StrEnum


class BenchmarkName(StrEnum):
    """A benchmark's name in asv's results."""

    STEP_TIME = "step.Step.time_1000_steps"
    """Time of 1000 steps, unpaired."""
    HEAVY_STEP_TIME = "step.HeavyStep.time_100_steps"
    """Time of 100 steps of the models whose step takes most of a millisecond, unpaired."""
    RATIO_TO_REFERENCE = "reference.Reference.track_ratio_to_reference"
    """Time of a step over the reference release's, paired."""
    INSTRUCTIONS = "instructions.Instructions.track_instructions_per_step"
    """Instructions of a step, counted: exact."""
    CONTACTS = "step.Work.track_contacts"
    CONSTRAINTS = "step.Work.track_constraints"
    SOLVER_ITERATIONS = "step.Work.track_solver_iterations"
    DRIFT = "step.Drift.track_drift"
    """How far one step leads from the reference release's result."""


# Unpaired times of a step; every model has one of them.
STEP_TIMES = (BenchmarkName.STEP_TIME, BenchmarkName.HEAVY_STEP_TIME)
# Benchmarks that count the work of a step, by what they count.
WORK_COUNTERS = {
    "contacts": BenchmarkName.CONTACTS,
    "constraints": BenchmarkName.CONSTRAINTS,
    "solver iterations": BenchmarkName.SOLVER_ITERATIONS,
}
