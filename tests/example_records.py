"""Invented records of a comparison, for tests of what is derived from them."""

from typing import Any

from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.simulation.accelerated_limits import AcceleratedCheck, Precision
from mjbench.simulation.work import ModelFacts, Work
from mjbench.status import Status

FACTS = ModelFacts(
    nq=2,
    nv=2,
    nu=1,
    na=0,
    contacts=0,
    constraints=0,
    timestep=0.002,
    integrator="euler",
    solver="newton",
    cone="pyramidal",
)
CHECK = AcceleratedCheck(
    precision=Precision.FLOAT32,
    received=True,
    still=False,
    unconstrained_steps=8,
    constrained_steps=0,
    contact_steps=1,
    unconstrained_error=1e-7,
    constrained_error=None,
    contact_error=1e-3,
    unconstrained_nstep=3,
    unconstrained_difference=2e-7,
    unconstrained_shadow=1e-7,
    final_nstep=9,
    final_difference=1e-2,
    final_shadow=1e-6,
    final_shadow_median=1e-7,
    lost=0,
)
WORK = Work(contacts=1.0, constraints=4.0, solver_iterations=2.0)


def model_record(**fields: Any) -> ModelRecord:
    """Return a model's record: 10 simulations of 100 steps of 2 ms."""
    usual = {"model": "m", "status": Status.OK, "facts": FACTS, "nbatch": 10, "nstep": 100}
    return ModelRecord(**{**usual, "hold": 1, "work": WORK, "reduced": False, **fields})


def measurement(**fields: Any) -> MeasurementRecord:
    """Return the record of a path that agrees: 10 simulations of 100 steps."""
    usual: dict[str, Any] = {
        "model": "m",
        "path": "python_loop",
        "options": {},
        "status": Status.OK,
        "agrees": True,
        "agreement": "bit-identical",
        "nbatch": 10,
        "nstep": 100,
        "hold": 1,
        "diverged": 0,
        "workload_digest": "w",
        "work": WORK,
        "snippet": "pass",
    }
    return MeasurementRecord(**{**usual, **fields})
