"""What C does, and its shadow, for an engine that only rounds otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from mjbench.simulation import compat, reference_run, rounding_reference
from mjbench.simulation.rounding_reference import RoundingReference
from mjbench.simulation.workload import Workload


@pytest.fixture
def traced(small: Workload) -> RoundingReference:
    return rounding_reference.trace(small, seed=0)


def test_the_run_is_that_of_the_plain_loop(small: Workload, traced: RoundingReference) -> None:
    every_step = range(small.nstep + 1)
    np.testing.assert_array_equal(traced.run.states, reference_run.states_after(small, every_step))
    spec = compat.INTEGRATION
    assert dict(traced.run.columns) == compat.state_columns(small.model, spec)


def test_the_shadow_differs_by_rounding_from_the_first_step_on(traced: RoundingReference) -> None:
    shadow = traced.run.shadow
    assert shadow[0] == 0.0
    assert (shadow[1:] > 0).all()
    assert (np.diff(shadow) >= 0).all()
    assert shadow[1] < 1e-12
    assert 0 < traced.steps.shadow.max() < 1e-12


def test_single_steps_lead_where_c_leads_with_every_input_set(
    small: Workload, traced: RoundingReference
) -> None:
    steps = traced.steps
    alone = replace(small, initial_state=steps.state, control=steps.control[:, None], hold=1)
    np.testing.assert_array_equal(steps.after, reference_run.states_after(alone, [1])[0])
    forces = traced.run.columns["xfrc_applied"]
    has_forces = steps.state[:, forces].any(axis=1)
    assert has_forces.sum() == len(steps.state) // 2
    step_of = np.arange(len(steps.state)) % small.nstep
    assert {True, False} == set(has_forces[step_of < small.nstep // 2].tolist())


def test_it_is_known_which_steps_a_constraint_acts_on(traced: RoundingReference) -> None:
    assert traced.steps.is_constrained.all()  # the model starts in contact
    assert traced.run.unconstrained_nstep == 0


def test_the_same_seed_gives_the_same_shadow(small: Workload, traced: RoundingReference) -> None:
    again = rounding_reference.trace(small, seed=0)
    np.testing.assert_array_equal(again.run.shadow, traced.run.shadow)
    other = rounding_reference.trace(small, seed=1)
    assert (other.run.shadow != traced.run.shadow).any()


def test_differences_are_relative_to_large_fields_alone() -> None:
    columns = {"qpos": slice(0, 2), "qvel": slice(2, 4), "ctrl": slice(4, 5)}
    want = np.array([[100.0, 0.0, 0.1, 0.2, 5.0]])
    got = want + np.array([[1.0, 0.0, 0.005, 0.0, 3.0]])
    assert rounding_reference.differences(got, want, columns) == pytest.approx([0.01])
