"""What follows from the samples of an environment."""

import numpy as np
import pytest
from example_environment_records import ROUNDS, facts, record, steady

from mjbench.commands.env.layers import Layer
from mjbench.commands.env.result import EnvironmentRecord, PhysicsCheck, VectorForm, VectorSamples
from mjbench.commands.env.timer import LayerSamples, TimerCost
from mjbench.status import Status


def test_layers_are_without_what_timing_them_cost_and_add_up_to_the_step() -> None:
    row = record()
    shares = {layer.layer: layer.share.estimate for layer in row.layer_shares}
    # a call costs 1 µs, as much inside as outside
    assert shares == pytest.approx(
        {
            Layer.PHYSICS: 0.60,
            Layer.OBSERVATION: 0.30,
            Layer.REST: 0.08,
            Layer.WRAPPERS: 0.02,
            Layer.REWARD: 0.0,
        },
        abs=1e-6,
    )
    assert sum(shares.values()) == pytest.approx(1.0)
    assert [layer.layer for layer in row.layer_shares][:2] == [Layer.PHYSICS, Layer.OBSERVATION]
    assert sum(layer.ns for layer in row.layer_shares) == pytest.approx(100_000.0)
    assert row.timer.call_ns == 1000.0
    assert row.timer.calls == 4.0
    assert row.timer.share == pytest.approx(0.04)
    assert row.timer.sum.estimate == pytest.approx(1.0, abs=1e-3)


def test_a_timed_call_costs_at_least_what_a_loop_of_them_shows() -> None:
    row = record(timer_ns=[-3_000.0] * ROUNDS, timer_cost=TimerCost(300.0, 100.0))
    assert row.timer.call_ns == 400.0
    assert row.timer.sum.estimate > 1  # and then the layers do not add up to the plain step


def test_steps_that_the_clock_did_not_see_have_shares() -> None:
    row = record(step_ns=[0.0] * ROUNDS)
    assert np.isfinite(row.timer.sum.estimate)


def test_what_the_layers_lack_is_seen_in_their_sum() -> None:
    layers = record().layers[:-2]  # as if the observation had not been timed
    row = record(layers=layers)
    assert row.timer.sum.estimate < 0.75


def test_functions_of_a_layer_stand_together() -> None:
    layers = [*record().layers, LayerSamples(Layer.PHYSICS, "mj_step1", 5.0, 0.0, 0.0, steady(9e4))]
    physics = record(layers=layers).layer_shares[0]
    assert physics.layer == Layer.PHYSICS
    assert [function.name for function in physics.functions] == ["mj_step1", "mj_step"]
    assert physics.functions[0].calls == 5.0
    assert physics.share.estimate == pytest.approx(sum(f.share for f in physics.functions))


def test_speeds_are_in_steps_of_the_environment_and_of_the_engine() -> None:
    row = record()
    assert row.env_steps_per_s == pytest.approx(10_000.0)
    assert row.steps_per_s == pytest.approx(50_000.0)
    rollout = next(path for path in row.physics_paths if path.path == "rollout")
    assert rollout.env_steps_per_s == pytest.approx(50_000.0)
    assert rollout.steps_per_s == pytest.approx(250_000.0)
    assert rollout.speedup.estimate == pytest.approx(5.0)
    assert rollout.over_loop.estimate == pytest.approx(2.5)


def test_a_varying_number_of_steps_has_no_speed_of_the_engine() -> None:
    row = record(facts=facts(frame_skip=None))
    assert row.steps_per_s is None
    assert row.physics_paths[0].steps_per_s is None


def test_a_reset_is_spread_over_the_steps_of_an_episode() -> None:
    row = record()
    assert row.reset.step_ns == pytest.approx(200_000.0 / 20)
    assert row.reset.episode_share == pytest.approx(2 / 22)
    endless = record(facts=facts(episode_nstep=None)).reset
    assert endless.step_ns is None
    assert endless.episode_share == pytest.approx(2 / 102)


def test_a_vectorised_form_is_compared_with_one_environment() -> None:
    sync, asynchronous = record().vectors
    assert sync.speedup.estimate == pytest.approx(1.0)
    assert asynchronous.speedup.estimate == pytest.approx(1.5)
    assert asynchronous.env_steps_per_s == pytest.approx(12_500.0)


def test_processes_add_what_a_step_takes_beyond_its_share_of_the_cores() -> None:
    samples = VectorSamples(VectorForm.ASYNC, 8, Status.OK, "", steady(9e4), steady(1e5), 2)
    (known,) = record(vectors=[samples]).vectors
    assert (known.step_ns, known.overhead_ns) == (pytest.approx(5e4), pytest.approx(4e4))
    sync, _ = record().vectors
    assert (sync.step_ns, sync.overhead_ns) == (None, None)


def test_what_was_not_timed_has_no_figures() -> None:
    row = EnvironmentRecord(environment="Robot-v0", status=Status.FAILED, detail="no")
    assert (row.step, row.layer_shares, row.timer, row.rounds) == (None, [], None, 0)
    assert row.statuses() == [Status.FAILED]
    rounds = "step_ns reset_ns layered_ns timer_ns layers paths cores vectors"
    untimed = record(**dict.fromkeys(rounds.split(), ()))
    assert untimed.step is None
    assert untimed.check is not None


def test_statuses_are_those_of_the_check_the_paths_and_the_forms() -> None:
    check = PhysicsCheck(Status.DISAGREES, "qpos[0] differs", 3)
    statuses = record(check=check).statuses()
    assert statuses[:2] == [Status.OK, Status.DISAGREES]
    assert len(statuses) == 2 + 4 + 2
