"""C's own solution is found again from its contacts, and others are measured from it."""

import copy

import numpy as np
import pytest

from mjbench.simulation import models, reference_trajectory, workload
from mjbench.simulation.constraint_problem import ConstraintProblem, converging
from mjbench.simulation.contacts import Contacts


def touching_state(name: str) -> tuple[ConstraintProblem, workload.Workload]:
    """Return the problem of a shipped model, loaded with a state in contact."""
    model = models.load(models.resolve(name))
    sample = workload.make(model, 2, 30)
    problem = ConstraintProblem(model)
    run = reference_trajectory.record_trajectory(sample, 2)
    for state, control in zip(run.states[0], sample.control[0], strict=False):
        problem.load(state, control)
        if len(problem.contacts.simulation) >= 4:
            return problem, sample
    raise AssertionError("it touches nothing")


@pytest.mark.parametrize("name", ["cube_table", "humanoid", "gripper"])
def test_c_solves_its_own_contacts_to_the_same_accelerations(name: str) -> None:
    problem, _ = touching_state(name)
    solution = problem.solve(problem.contacts)
    assert problem.acceleration_error(solution.qacc, problem.own) < 1e-9
    assert problem.force_error(solution.qfrc_constraint, problem.own) < 1e-9


def test_a_missing_contact_changes_the_solution() -> None:
    problem, _ = touching_state("cube_table")
    without = problem.contacts.select(np.arange(1, len(problem.contacts.simulation)))
    assert problem.acceleration_error(problem.solve(without).qacc, problem.own) > 1e-3


def test_an_error_of_a_hundredth_of_the_force_is_a_hundredth() -> None:
    problem, _ = touching_state("cube_table")
    force = 1.01 * problem.own.qfrc_constraint
    assert problem.force_error(force, problem.own) == pytest.approx(0.01, rel=0.3)


def test_accelerations_that_are_not_finite_are_infinitely_far() -> None:
    problem, _ = touching_state("cube_table")
    assert problem.acceleration_error(problem.own.qacc * np.nan, problem.own) == np.inf


def test_geoms_that_never_touch_in_c_have_no_example() -> None:
    problem, _ = touching_state("cube_table")
    strange = copy.copy(problem.contacts.geom)
    strange[:, 0] = 99
    contacts = problem.contacts
    other = Contacts(
        contacts.simulation, strange, contacts.distance, contacts.position, contacts.frame
    )
    assert problem.has_examples(contacts)
    assert not problem.has_examples(other)


def test_a_solver_that_goes_on_to_the_solution_is_not_moved_from_it_by_noslip_iterations() -> None:
    model = models.load(models.resolve("cube_table"))
    model.opt.noslip_iterations = 3
    assert converging(model).opt.noslip_iterations == 0
