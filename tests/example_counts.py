"""Invented counts of instructions, by function."""

from dataclasses import replace

import numpy as np

from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import FunctionCount
from mjbench.simulation.reference_run import Work
from mjbench.simulation.state_drift import Followed


def counted(
    release: str, calls: frozenset[tuple[str, str]] = frozenset(), **functions: float
) -> ModelCount:
    """Return what a release executes in a step of one model; all of it is the solver's."""
    total = sum(functions.values())
    return ModelCount(
        model="pile",
        release=release,
        instructions_per_step=total,
        outside_per_step=1.0,
        functions=[FunctionCount(name, cost, cost) for name, cost in functions.items()],
        calls=calls,
        stages={"solver": total, "sensors": 0.0},
        work=Work(contacts=4.0, constraints=16.0, solver_iterations=3.0),
    )


def followed_counts() -> tuple[ModelCount, ModelCount, ModelCount]:
    """Return a count, one of a release that leads to the same state, and one that does not."""
    here, elsewhere = {"qpos": np.array([[[1.0]]])}, {"qpos": np.array([[[1.0 + 1e-6]]])}
    healthy = np.ones(1, dtype=bool)
    return tuple(
        replace(counted(release, a=1000.0), healthy=healthy, followed=Followed([0], here, after))
        for release, after in (("1.0", here), ("2.0", here), ("2.0", elsewhere))
    )
