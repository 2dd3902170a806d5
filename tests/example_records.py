"""Invented records of a comparison, for tests of what is derived from them."""

from typing import Any

from mjbench.simulation.accelerated_judgement import (
    EngineAnswer,
    EngineJudgement,
    JudgedPart,
    Measure,
    PairContacts,
    PartName,
    Precision,
)
from mjbench.simulation.reference_run import ModelFacts, Work
from mjbench.status import Status
from mjbench.verification.records import ModelRecord, VariantRecord

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
    can_fall=False,
    has_clock=True,
)
PAIR = PairContacts(
    types=("plane", "sphere"),
    states=8,
    other_counts=0,
    count=4.0,
    count_in_c=4.0,
    distance_m=1e-9,
    position_m=1e-9,
    normal_degrees=0.0,
    effect=1e-6,
    largest_effect=1e-5,
    answer=EngineAnswer.YES,
)
JUDGED = EngineJudgement.of(
    Precision.FLOAT32,
    [
        JudgedPart.of(PartName.SMOOTH, Measure("a step without constraints", 1e-7, 1e-4)),
        JudgedPart(PartName.CONTACTS, EngineAnswer.YES),
        JudgedPart.of(
            PartName.CONSTRAINTS, Measure("forces of the solution", 1e-5, 1e-4, in_c=1e-9)
        ),
    ],
    [PAIR],
    states=9,
    contact_states=8,
)
WORK = Work(contacts=1.0, constraints=4.0, solver_iterations=2.0)


def model_record(**fields: Any) -> ModelRecord:
    """Return a model's record: 10 simulations of 100 steps of 2 ms."""
    usual = {"model": "m", "status": Status.OK, "facts": FACTS, "nbatch": 10, "nstep": 100}
    usual |= {"diverged": 0, "workload_digest": "w"}
    return ModelRecord(**{**usual, "hold": 1, "work": WORK, "reduced": False, **fields})


def measurement(**fields: Any) -> VariantRecord:
    """Return the record of a path that agrees."""
    usual: dict[str, Any] = {
        "model": "m",
        "path": "python_loop",
        "options": {},
        "status": Status.OK,
        "agrees": True,
        "agreement": "bit-identical",
        "snippet": "pass",
    }
    return VariantRecord(**{**usual, **fields})
