"""Attempts in processes of their own: what settings do to the states, and how they fail."""

import dataclasses
import pickle

import mujoco
import pytest

from mjbench.errors import InputError
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning import measurements, reference, trajectories
from mjbench.tuning.measurements import CMeasurements
from mjbench.tuning.records import Effect
from mjbench.tuning.reference import TrialPlan
from mjbench.tuning.settings import Edit, LoopChange, Part, Setting, option


@pytest.fixture(scope="module")
def cartpole():
    """Return measurements of the cart-pole, in short runs."""
    with WorkerPool() as pool:
        of_cartpole = CMeasurements(pool, models.resolve("cartpole"), StartPlan())
        facts = of_cartpole.baseline(TrialPlan(0, StartPlan(), ncontrol=8))
        assert facts.nrun == reference.NRUN
        assert facts.error.share > 0
        assert of_cartpole._model_file.stat().st_size > 0
        yield of_cartpole


def tried(measurements, *settings, quads=0, **keywords):
    return measurements.attempt(settings, quads=quads, **keywords)


def test_what_changes_no_state_is_free(cartpole):
    flag = Setting("island", "island=disable", (Edit(Part.FLAG, "island", "disable"),))
    done = tried(cartpole, flag)
    assert done.status == Status.OK
    assert done.accuracy.effect == Effect.FREE
    assert done.accuracy.distance.share == 0.0
    assert done.time_ratio is None


def test_a_larger_timestep_errs_more_and_its_time_is_of_a_simulated_second(cartpole):
    done = tried(cartpole, option("timestep", "0.004"), quads=2)
    assert done.accuracy.effect == Effect.APPROXIMATE
    assert done.accuracy.error.share > done.accuracy.distance.share / 2 > 0
    assert len(done.accuracy.run_errors) == reference.NRUN
    assert done.time_ratio > 0


def test_fewer_runs_are_spread_over_all(cartpole):
    some, every = (tried(cartpole, option("timestep", "0.004"), nrun=nrun) for nrun in (8, None))
    errors = every.accuracy.run_errors
    assert some.accuracy.run_errors == [errors[i * 63 // 7] for i in range(8)]
    assert some.accuracy.run_errors != errors[:8]


def test_the_loop_has_settings_of_its_own(cartpole):
    done = tried(
        cartpole,
        Setting("engine clock", "clock off", loop=LoopChange(is_clock_off=True)),
        quads=2,
    )
    assert done.accuracy.effect == Effect.FREE
    assert done.time_ratio > 0


def test_a_loop_that_reaches_other_states_is_refused(monkeypatch):
    model = models.load(models.resolve("cartpole"))
    baseline = reference.baseline(model, TrialPlan(0, StartPlan(), ncontrol=4))
    pool = LoopChange(engine_threads=1)
    measurements._check_loop(model, pool, baseline.trials, baseline.present)
    other = trajectories.run(reference.converged(model, 2), baseline.trials)
    with pytest.raises(InputError, match="other final states"):
        measurements._check_loop(model, pool, baseline.trials, other)


@pytest.mark.parametrize(
    ("setting", "status", "detail"),
    [
        (option("timestep", "0.003"), Status.INPUT, "does not divide"),
        (option("bogus", "1"), Status.INPUT, "bogus"),
        (option("solver", "bogus"), Status.INPUT, "bogus"),
        (option("timestep", "-1"), Status.INPUT, "timestep"),
    ],
)
def test_settings_that_cannot_be_are_one_line(cartpole, setting, status, detail):
    done = tried(cartpole, setting)
    assert done.status == status
    assert detail in done.detail and "\n" not in done.detail
    assert done.accuracy is None


def test_settings_that_hang_are_ended(cartpole, monkeypatch):
    monkeypatch.setattr(cartpole, "_limit_s", 0.001)
    done = tried(cartpole, option("timestep", "0.004"))
    assert done.status == Status.TIMEOUT
    assert "no answer" in done.detail


def test_settings_that_diverge_are_one_line(tmp_path):
    stiff = tmp_path / "stiff.xml"
    stiff.write_text(
        """<mujoco><option timestep="0.001"/><worldbody><body><joint stiffness="6000"/>
        <geom size="0.1" pos="0.1 0 0"/></body></worldbody><keyframe><key qpos="1"/></keyframe>
        </mujoco>"""
    )
    with WorkerPool() as pool:
        of_stiff = CMeasurements(pool, models.ModelSource("stiff", stiff), StartPlan())
        of_stiff.baseline(TrialPlan(0, StartPlan(), ncontrol=50))
        done = tried(of_stiff, option("timestep", "0.008"))
    assert done.status == Status.INPUT
    assert "diverges in" in done.detail


def judged_after(model, baseline, change):
    """Return the effect of a change of a model's options."""
    changed = models.load(models.resolve("cube_table"))
    change(changed.opt)
    return measurements.judged(model, baseline, trajectories.run(changed, baseline.trials))


def test_another_solver_that_converges_is_equivalent_and_a_loose_one_is_not():
    model = models.load(models.resolve("cube_table"))
    baseline = reference.baseline(model, TrialPlan(0, StartPlan(), ncontrol=12))

    def tighter(opt):
        opt.tolerance = 1e-10

    def one_iteration(opt):
        opt.solver, opt.iterations = mujoco.mjtSolver.mjSOL_PGS, 1

    accuracy = judged_after(model, baseline, tighter)
    assert accuracy.effect in (Effect.FREE, Effect.EQUIVALENT)
    assert accuracy.distance.share <= baseline.facts.error.share
    accuracy = judged_after(model, baseline, one_iteration)
    assert accuracy.effect == Effect.APPROXIMATE


def test_effects_are_ordered():
    assert [effect.rank for effect in Effect] == [0, 1, 2]


def test_a_baseline_of_fewer_runs_has_the_same_facts(cartpole):
    baseline = pickle.loads(cartpole._baseline_file.read_bytes())
    some = baseline.only(5)
    assert some.trials.nrun == len(some.present.qpos) == len(some.reference.qpos) == 5
    assert some.facts == baseline.facts
    assert dataclasses.replace(some.facts, nrun=1) != baseline.facts
