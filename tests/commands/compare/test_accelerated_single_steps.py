"""Single steps where bodies touch: what rounding to float32 excuses, and what it does not."""

import copy
import dataclasses
import itertools

import mujoco
import numpy as np
import pytest
from example_records import PAIR
from pretender import Pretender32, make_workload

from mjbench.commands.compare.accelerated_agreement import probe_workload, take_single_steps
from mjbench.commands.compare.accelerated_single_steps import (
    Budget,
    JudgedConstraints,
    _Errors,
    _solution_part,
    judge_constraints,
    judge_warm_start,
)
from mjbench.paths.accelerated import StepOutcome
from mjbench.simulation import compat, reference_trajectory
from mjbench.simulation.accelerated_judgement import EngineAnswer, JudgedPart, PartName, Precision
from mjbench.simulation.constraint_problem import converging
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.reference_trajectory import SingleSteps
from mjbench.simulation.workload import Workload


def at_rest_pose(name: str) -> Workload:
    """Return a workload whose simulations start where the model's file puts them."""
    workload = make_workload(name, nstep=40)
    state = np.empty(compat.state_size(workload.model))
    compat.get_state(workload.model, mujoco.MjData(workload.model), state)
    return dataclasses.replace(
        workload, initial_state=np.tile(state, (len(workload.initial_state), 1))
    )


def converged_steps(workload: Workload) -> tuple[SingleSteps, StepOutcome]:
    """Return single steps of a run, and what C in float32 makes of them."""
    run = reference_trajectory.record_trajectory(workload, workload.nbatch)
    singles = reference_trajectory.single_steps(workload, run, 64, rounded=True)
    probe = probe_workload(converging(workload.model), workload)
    compiled = Pretender32().compile(probe, {}, Peaks(0, 0))
    return singles, take_single_steps(compiled, singles)


def judged(workload: Workload, singles: SingleSteps, outcome: StepOutcome) -> JudgedConstraints:
    return judge_constraints(workload.model, singles, outcome, outcome, Precision.FLOAT32)


def without_last_contact(outcome: StepOutcome) -> StepOutcome:
    """Return steps of which each lacks its last contact."""
    assert outcome.contacts is not None
    simulation = outcome.contacts.simulation
    is_last = np.append(simulation[1:] != simulation[:-1], True)
    return dataclasses.replace(outcome, contacts=outcome.contacts.select(~is_last))


def test_a_lost_contact_is_a_fault_where_the_run_starts_at_an_exact_touch() -> None:
    workload = at_rest_pose("cube_table")
    singles, outcome = converged_steps(workload)
    assert judged(workload, singles, outcome).contacts.answer == EngineAnswer.YES
    lost = judged(workload, singles, without_last_contact(outcome))
    assert lost.contacts.answer == EngineAnswer.NO


def test_forces_off_by_two_hundredths_are_a_fault_in_float32() -> None:
    workload = make_workload("gripper", nstep=40)
    singles, outcome = converged_steps(workload)
    assert judged(workload, singles, outcome).constraints.answer == EngineAnswer.YES
    wrong = dataclasses.replace(outcome, qfrc_constraint=1.02 * outcome.qfrc_constraint)
    assert judged(workload, singles, wrong).constraints.answer == EngineAnswer.NO


def test_no_state_is_begun_after_the_time_for_it_and_those_judged_are_counted() -> None:
    workload = make_workload("cube_table", nstep=40)
    singles, outcome = converged_steps(workload)
    begun: list[int] = []

    def judged_within(limit_s: float) -> int:
        seconds = itertools.count()  # a second passes whenever the clock is read
        budget = Budget(limit_s, lambda: begun.append(1), lambda: float(next(seconds)))
        model, precision = workload.model, Precision.FLOAT32
        return judge_constraints(model, singles, outcome, outcome, precision, budget).states

    assert judged_within(9.0) == 10
    assert len(begun) == 20
    assert judged_within(0.0) == 1
    assert judged_within(1000.0) == len(singles.state)


def test_a_model_without_degrees_of_freedom_depends_on_no_warm_start() -> None:
    none = np.zeros((4, 0))
    assert judge_warm_start(none, none, none, is_deterministic=False).answer == EngineAnswer.YES


@pytest.mark.parametrize("error", [0.0, 0.01])
def test_a_state_in_which_c_is_far_from_the_solution_excuses_no_other(error: float) -> None:
    workload = make_workload("humanoid", nstep=40)
    model = copy.copy(workload.model)
    model.opt.iterations = 1
    workload = dataclasses.replace(workload, model=model)
    singles, converged = converged_steps(workload)
    timed = take_single_steps(Pretender32().compile(workload, {}, Peaks(0, 0)), singles)
    is_free = singles.constraints == 0
    assert 0 < is_free.sum() < len(is_free)
    qacc = timed.qacc * np.where(is_free, 1.0 + error, 1.0)[:, None]
    timed = dataclasses.replace(timed, qacc=qacc)
    part = judge_constraints(model, singles, converged, timed, Precision.FLOAT32).constraints
    assert part.answer == (EngineAnswer.NO if error else EngineAnswer.YES), part.reason


def test_a_state_whose_rounding_is_not_finite_hides_no_other() -> None:
    infinite, fine = float("inf"), 0.0
    errors = _Errors(
        acceleration=[infinite, 5.0],
        force=[infinite, 3.0],
        rounding=[infinite, fine],
        force_rounding=[infinite, fine],
    )
    part = _solution_part(errors, Precision.FLOAT32)
    assert part.answer == EngineAnswer.NO
    assert [measure.value for measure in part.measures] == [5.0, 3.0]


def test_without_a_state_whose_rounding_is_finite_nothing_is_judged() -> None:
    infinite = [float("inf")]
    errors = _Errors(
        acceleration=infinite, force=infinite, rounding=infinite, force_rounding=infinite
    )
    assert _solution_part(errors, Precision.FLOAT32).answer == EngineAnswer.NOT_JUDGED


@pytest.mark.parametrize(
    ("answer", "effect", "expected"),
    [
        (EngineAnswer.YES, 5e-5, True),
        (EngineAnswer.YES, 4e-3, False),  # as much as rounding does in this model, but elsewhere
        (EngineAnswer.CLOSE, 5e-5, False),
    ],
)
def test_a_run_is_held_to_that_of_c_only_where_contacts_are_the_same(
    answer: EngineAnswer, effect: float, expected: bool
) -> None:
    distances = {"distance_m": 1e-5, "position_m": 0.01}
    pair = dataclasses.replace(
        PAIR, **distances, effect=effect, largest_effect=effect, answer=answer
    )
    part = JudgedPart(PartName.CONTACTS, answer)
    judged = JudgedConstraints(Precision.FLOAT32, part, part, (pair,), 60, 60)
    assert judged.has_same_contacts == expected
