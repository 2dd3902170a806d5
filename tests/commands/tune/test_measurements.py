"""Settings in processes of their own: what they do to states and sensors, and how they fail."""

import copy
import dataclasses
import pickle
from unittest import mock

import inline_tasks
import isolated_tasks
import mujoco
import pytest
from commands import PYTHONPATH

from mjbench.commands.tune import (
    measurements,
    reference,
    setting_launch,
    solver_convergence,
    trajectories,
)
from mjbench.commands.tune.measurements import CMeasurements
from mjbench.commands.tune.reference import TrialPlan
from mjbench.commands.tune.result import Effect
from mjbench.commands.tune.setting_launch import SettingLaunchRequest
from mjbench.commands.tune.settings import Edit, LoopChange, Part, Setting, option
from mjbench.errors import InputError
from mjbench.host import isolate
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status


@pytest.fixture(scope="module", autouse=True)
def brief():
    """Draw starts from fewer settling runs, which take most of the time."""
    with mock.patch.object(reference, "DRAWS", 4):
        yield


@pytest.fixture(scope="module")
def cartpole():
    """Return measurements of the cart-pole, in short runs, prepared in this process."""
    with WorkerPool() as pool:
        of_cartpole = CMeasurements(pool, models.resolve("cartpole"), StartPlan())
        with mock.patch.object(isolate, "run", inline_tasks.run):
            facts, stages, *_ = of_cartpole.present(TrialPlan(0, StartPlan(), ncontrol=8))
            assert facts.error is None
            assert sum(stages.values()) == pytest.approx(1.0)
            facts = of_cartpole.reference()
        assert facts.nrun == reference.NRUN
        assert facts.error.share > 0
        yield of_cartpole


def tried(measurements, *settings, nrun=None, timed_s=0.0, **keywords):
    (attempt,) = measurements.launch(SettingLaunchRequest([settings], timed_s, nrun, **keywords))
    return attempt


def test_what_changes_no_state_is_free(cartpole, inline):
    flag = Setting("island", "island=disable", (Edit(Part.FLAG, "island", "disable"),))
    done = tried(cartpole, flag)
    assert done.status == Status.OK
    assert done.accuracy.effect == Effect.FREE
    assert done.accuracy.distance.share == 0.0
    assert done.time_ratio is None


def test_a_larger_timestep_errs_more_and_its_time_is_of_a_simulated_second(cartpole):
    done = tried(cartpole, option("timestep", "0.004"), timed_s=0.01)
    assert done.accuracy.effect == Effect.APPROXIMATE
    assert done.accuracy.error.share > done.accuracy.distance.share / 2 > 0
    assert len(done.accuracy.run_errors) == reference.NRUN
    assert done.time_ratio > 0


def test_fewer_runs_are_spread_over_all(cartpole, inline):
    some, every = (tried(cartpole, option("timestep", "0.004"), nrun=nrun) for nrun in (8, None))
    errors = every.accuracy.run_errors
    assert some.accuracy.run_errors == [errors[i * 63 // 7] for i in range(8)]
    assert some.accuracy.run_errors != errors[:8]


def test_the_loop_has_settings_of_its_own(cartpole):
    done = tried(
        cartpole,
        Setting("timer", "clock off", loop=LoopChange(is_clock_off=True)),
        timed_s=0.01,
    )
    assert done.accuracy.effect == Effect.FREE
    assert done.time_ratio > 0


def test_a_loop_that_reaches_other_states_is_refused():
    model = models.load(models.resolve("cartpole"))
    baseline = reference.present_runs(model, TrialPlan(0, StartPlan(), ncontrol=4))
    pool = LoopChange(engine_threads=1)
    setting_launch.check_loop(model, pool, baseline.trials, baseline.present)
    other = trajectories.run(solver_convergence.converged(model, 2), baseline.trials)
    with pytest.raises(InputError, match="other final states"):
        setting_launch.check_loop(model, pool, baseline.trials, other)


@pytest.mark.parametrize(
    ("setting", "status", "detail"),
    [
        (option("timestep", "0.003"), Status.INPUT, "does not divide"),
        (option("bogus", "1"), Status.INPUT, "bogus"),
        (option("solver", "bogus"), Status.INPUT, "bogus"),
        (option("timestep", "-1"), Status.INPUT, "timestep"),
        (Setting("x", "x", (Edit(Part.EXCLUDE, "a", "b"),)), Status.INPUT, "exclude a b"),
    ],
)
def test_settings_that_cannot_be_are_one_line(cartpole, setting, status, detail, inline):
    done = tried(cartpole, setting)
    assert done.status == status
    assert detail in done.detail and "\n" not in done.detail
    assert done.accuracy is None


def test_settings_that_hang_are_ended(cartpole, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)
    monkeypatch.setattr(measurements, "run_launch", isolated_tasks.hang_at_a_timestep)
    monkeypatch.setattr(cartpole, "_limit_s", 3.0)
    settings = [(option("timestep", timestep),) for timestep in ("0.004", "0.008", "0.016")]
    first, second, third = cartpole.launch(SettingLaunchRequest(settings))
    assert (first.status, second.status) == (Status.OK, Status.TIMEOUT)
    assert "no answer" in second.detail
    assert (third.settings, third.status) == (settings[2], Status.OK)


def test_settings_that_diverge_are_one_line(tmp_path, inline):
    stiff = tmp_path / "stiff.xml"
    stiff.write_text(
        """<mujoco><option timestep="0.001"/><worldbody><body><joint stiffness="6000"/>
        <geom size="0.1" pos="0.1 0 0"/></body></worldbody><keyframe><key qpos="1"/></keyframe>
        </mujoco>"""
    )
    with WorkerPool() as pool:
        of_stiff = CMeasurements(pool, models.ModelSource("stiff", stiff), StartPlan())
        of_stiff.present(TrialPlan(0, StartPlan(), ncontrol=50))
        done = tried(of_stiff, option("timestep", "0.008"))
    assert done.status == Status.INPUT
    assert "diverges in" in done.detail


def judged_after(model, baseline, change):
    """Return what a change of a model's options comes to."""
    changed = copy.copy(model)
    change(changed.opt)
    return setting_launch.judged(model, baseline, trajectories.run(changed, baseline.trials))


def conjugate_gradient(opt):
    opt.solver = mujoco.mjtSolver.mjSOL_CG


def one_iteration(opt):
    opt.solver, opt.iterations = mujoco.mjtSolver.mjSOL_PGS, 1


def other_cone(opt):
    opt.cone = 1 - opt.cone


def doubled_timestep(opt):
    opt.timestep *= 2


def test_a_solver_that_converges_too_is_equivalent_and_one_that_does_not_is_not():
    model = models.load(models.resolve("cube_table"))
    baseline = reference.present_runs(model, TrialPlan(0, StartPlan(), ncontrol=12))
    effects = [judged_after(model, baseline, c).effect for c in (conjugate_gradient, one_iteration)]
    assert effects == [Effect.EQUIVALENT, Effect.APPROXIMATE]


STACK = """<mujoco><option solver="PGS" iterations="{iterations}" timestep="0.004"/><worldbody>
<geom type="plane" size="5 5 .1"/>{boxes}</worldbody></mujoco>"""
BOX = "<body pos='0 0 {z}'><freejoint/><geom type='box' size='.05 .05 .05' mass='{mass}'/></body>"


def stack(iterations):
    boxes = "".join(BOX.format(z=0.05 + 0.1 * i, mass=10 if i == 5 else 1) for i in range(6))
    return mujoco.MjModel.from_xml_string(STACK.format(iterations=iterations, boxes=boxes))


def test_the_error_of_a_solver_that_does_not_converge_makes_nothing_equivalent():
    model = stack(iterations=5)
    baseline = reference.present_runs(model, TrialPlan(0, StartPlan(), ncontrol=4))
    assert not baseline.facts.is_converged
    for change in (other_cone, doubled_timestep):
        assert judged_after(model, baseline, change).effect == Effect.APPROXIMATE


# Rays that only see what is drawn.
RAYS = """<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
<geom type="box" size=".1 1 1" pos="2 0 0" contype="0" conaffinity="0"/>
<body pos="0 0 .5"><joint type="slide"/><geom size=".1"/><site name="eye" zaxis="1 0 0"/>
<site name="down" pos="0 0 -.2" zaxis="0 0 -1"/></body></worldbody>
<sensor><rangefinder site="eye"/><rangefinder site="down"/></sensor></mujoco>"""


def test_a_ray_that_loses_its_target_is_a_change(tmp_path, inline):
    file = tmp_path / "rays.xml"
    file.write_text(RAYS)
    discarded = Setting(
        "visual_geoms", "discardvisual=true", (Edit(Part.COMPILER, "discardvisual", "true"),)
    )
    with WorkerPool() as pool:
        of_rays = CMeasurements(pool, models.ModelSource("rays", file), StartPlan())
        of_rays.present(TrialPlan(0, StartPlan(), ncontrol=4))
        attempt = tried(of_rays, discarded)
    assert attempt.accuracy.changed_sensors == 1
    assert attempt.accuracy.effect == Effect.APPROXIMATE
    assert attempt.gives_up


def test_effects_are_ordered():
    assert [effect.rank for effect in Effect] == [0, 1, 2]


def test_a_baseline_of_fewer_runs_has_the_same_facts(cartpole):
    baseline = pickle.loads(cartpole._files.baseline.read_bytes())
    some = baseline.only(5)
    assert some.trials.nrun == len(some.present.qpos) == len(some.reference.qpos) == 5
    assert some.facts == baseline.facts
    assert dataclasses.replace(some.facts, nrun=1) != baseline.facts
