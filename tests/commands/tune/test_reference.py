"""The reference converges, and the horizon ends where errors or rounding have grown."""

import functools

import mujoco
import numpy as np
import pytest

from mjbench.commands.tune import accuracy, reference, solver_convergence, trajectories
from mjbench.commands.tune.reference import LEAST_NCONTROL, TrialPlan
from mjbench.errors import InputError
from mjbench.simulation import models
from mjbench.simulation.starts import StartPlan

PENDULUM = """<mujoco><option timestep="{timestep}" integrator="{integrator}"/><worldbody>
<body><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size="0.1"/></body>
</worldbody><keyframe><key qpos="1"/></keyframe></mujoco>"""


def baseline(model, plan, horizon_ncontrol=None):
    runs = reference.present_runs(model, plan)
    return reference.with_reference(model, runs, horizon_ncontrol)


@functools.cache
def pendulum_facts(timestep, integrator):
    xml = PENDULUM.format(timestep=timestep, integrator=integrator)
    model = mujoco.MjModel.from_xml_string(xml)
    return baseline(model, TrialPlan(0, StartPlan())).facts


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    """Draw starts from fewer settling runs, which take most of the time."""
    monkeypatch.setattr(reference, "DRAWS", 4)


def model_of(tmp_path, xml):
    file = tmp_path / "model.xml"
    file.write_text(xml)
    return models.load(models.ModelSource("model", file))


def test_the_error_of_a_first_order_integrator_is_proportional_to_its_timestep():
    errors = [pendulum_facts(timestep, "Euler").error.share for timestep in (0.002, 0.004)]
    assert errors[1] / errors[0] == pytest.approx(2.0, rel=0.2)


def test_a_higher_order_has_a_smaller_error_and_rounding_is_smaller_still():
    facts = {integrator: pendulum_facts(0.004, integrator) for integrator in ("Euler", "RK4")}
    assert facts["RK4"].error.share < 1e-3 * facts["Euler"].error.share
    assert facts["Euler"].rounding.share < 1e-6 * facts["Euler"].error.share
    assert facts["Euler"].solver.share == 0.0  # it has no constraint
    assert facts["Euler"].horizon_s == pytest.approx(facts["Euler"].run_s)


def test_a_model_that_moves_without_error_has_none(tmp_path):
    slide = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint type="slide"/>
    <geom size="1"/></body></worldbody><keyframe><key qvel="1"/></keyframe></mujoco>"""
    runs = baseline(model_of(tmp_path, slide), TrialPlan(0, StartPlan()))
    assert runs.facts.error.share < 1e-12
    assert runs.motion.position.m == pytest.approx(runs.facts.run_s, rel=0.1)


def test_a_converged_model_is_the_users_but_for_time_and_solver(tmp_path):
    model = model_of(tmp_path, PENDULUM.format(timestep=0.004, integrator="RK4"))
    tight = solver_convergence.converged(model, 8)
    assert tight.opt.timestep == pytest.approx(0.0005)
    assert model.opt.timestep == pytest.approx(0.004), "the user's stays as it is"
    assert tight.opt.integrator == model.opt.integrator
    assert tight.opt.cone == model.opt.cone
    assert tight.opt.iterations >= solver_convergence.ITERATIONS


def test_a_model_that_diverges_is_refused(tmp_path):
    unstable = """<mujoco><option timestep="0.5"/><worldbody><body><joint stiffness="1e9"/>
    <geom size="0.1" pos="1 0 0"/></body></worldbody><keyframe><key qpos="1"/></keyframe>
    </mujoco>"""
    with pytest.raises(InputError, match="diverge"):
        baseline(model_of(tmp_path, unstable), TrialPlan(0, StartPlan()))


def grown(rate, first, count=60):
    return first * np.exp(rate * np.arange(count))[None, :].repeat(3, axis=0)


def test_the_horizon_ends_where_the_error_is_a_tenth_of_the_motion():
    error = np.linspace(0.0, 0.2, 41)[None, :].repeat(3, axis=0)
    assert reference.horizon(error, np.zeros_like(error)) == 21


def test_the_horizon_ends_where_rounding_reaches_the_error():
    error, rounding = np.full((3, 60), 1e-3), grown(1.0, 1e-16)
    ncontrol = reference.horizon(error, rounding)
    assert rounding[0, ncontrol - 1] <= 1e-5 < rounding[0, ncontrol]


def test_a_tiny_error_does_not_end_the_horizon_while_rounding_is_tiny():
    assert reference.horizon(np.full((3, 60), 1e-14), np.full((3, 60), 1e-13)) == 60


def test_runs_that_part_at_once_cannot_be_compared():
    assert reference.horizon(np.full((3, 60), 0.9), np.zeros((3, 60))) == 0


def test_errors_of_a_model_that_is_off_at_once_are_not_compared(tmp_path):
    coarse = PENDULUM.format(timestep=0.3, integrator="Euler")
    facts = baseline(model_of(tmp_path, coarse), TrialPlan(0, StartPlan())).facts
    assert not facts.is_comparable
    assert facts.horizon_ncontrol <= LEAST_NCONTROL


def test_starts_come_from_several_settling_runs():
    model = models.load(models.resolve("cartpole"))
    trials, _ = reference.draw(model, TrialPlan(0, StartPlan(), ncontrol=4))
    times = trials.initial_state[:, 0]  # mjSTATE_TIME
    assert trials.nrun == reference.NRUN
    assert len(np.unique(np.round(times, 9))) <= trials.nrun // 2, "each run has the same times"
    others, _ = reference.draw(model, TrialPlan(1, StartPlan(), ncontrol=4))
    qpos = slice(1, 1 + model.nq)
    apart = np.abs(trials.initial_state[:, qpos] - others.initial_state[:, qpos]).max(axis=1)
    assert np.median(apart) > 1e-3


def test_a_second_look_has_the_length_and_the_horizon_of_the_first():
    model = models.load(models.resolve("cartpole"))
    facts = baseline(model, TrialPlan(1, StartPlan(), ncontrol=12), 5).facts
    assert (facts.ncontrol, facts.horizon_ncontrol, facts.is_comparable) == (12, 5, True)


def test_settings_are_compared_while_rounding_stays_small():
    model = models.load(models.resolve("cartpole"))
    runs = reference.present_runs(model, TrialPlan(0, StartPlan(), ncontrol=12))
    assert runs.same_ncontrol == 12
    assert runs.reference is runs.facts.error is None
    assert runs.facts.rounding.share < reference.SAME_SHARE / reference.ROUNDING_FACTOR


def test_trials_depend_on_the_seed_alone():
    model = models.load(models.resolve("cartpole"))
    first, again, other = (
        reference.draw(model, TrialPlan(seed, StartPlan(), ncontrol=6))[0] for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first.initial_state, again.initial_state)
    assert first.ncontrol == 6
    assert not np.array_equal(first.initial_state, other.initial_state)


def test_perturbed_starts_differ_in_the_last_place():
    model = models.load(models.resolve("humanoid"))
    trials, _ = reference.draw(model, TrialPlan(0, StartPlan(), ncontrol=4))
    other = reference.perturbed(model, trials)
    difference = np.abs(other.initial_state - trials.initial_state)
    assert 0 < difference.max() < 1e-14
    runs = [trajectories.run(model, each) for each in (trials, other)]
    scale = accuracy.motion(model, trials.initial_state[:, 1 : 1 + model.nq], runs[0])
    assert accuracy.distance(model, scale, *runs).share < 1e-9
