"""Invented counts of instructions, by function."""

from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import FunctionCount
from mjbench.simulation.reference_run import Work


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
