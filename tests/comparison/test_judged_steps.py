"""Single steps where bodies touch: what rounding to float32 excuses, and what it does not."""

import dataclasses

import mujoco
import numpy as np
from pretender import Pretender32, make_workload

from mjbench.comparison.accelerated_check import Program, probe_workload, take_single_steps
from mjbench.comparison.judged_steps import JudgedConstraints, judge_constraints
from mjbench.paths.accelerated import StepOutcome
from mjbench.simulation import compat, trajectory
from mjbench.simulation.constraint_problem import converging
from mjbench.simulation.judgement import Answer, Precision
from mjbench.simulation.trajectory import SingleSteps
from mjbench.simulation.work import Peaks
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
    run = trajectory.record_trajectory(workload, workload.nbatch)
    singles = trajectory.single_steps(workload, run, 64, rounded=True)
    probe = probe_workload(converging(workload.model), workload)
    compiled = Pretender32().compile(probe, {}, Peaks(0, 0))
    return singles, take_single_steps(Program(compiled.advance, probe), singles)


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
    assert judged(workload, singles, outcome).contacts.answer == Answer.YES
    lost = judged(workload, singles, without_last_contact(outcome))
    assert lost.contacts.answer == Answer.NO


def test_forces_off_by_two_hundredths_are_a_fault_in_float32() -> None:
    workload = make_workload("gripper", nstep=40)
    singles, outcome = converged_steps(workload)
    assert judged(workload, singles, outcome).constraints.answer == Answer.YES
    wrong = dataclasses.replace(outcome, qfrc_constraint=1.02 * outcome.qfrc_constraint)
    assert judged(workload, singles, wrong).constraints.answer == Answer.NO
