"""Starts lie along a settling run, after the model has settled."""

import dataclasses

import mujoco
import numpy as np
import pytest

from mjbench.simulation import compat, models, reference_run, starts, workload_sampling
from mjbench.simulation.starts import Later, SettleLimit, StartPlan, Starts, Window
from mjbench.simulation.workload_sampling import SampleRequest

# A ball 0.2 m above the floor, without a keyframe: it lands after 0.2 s.
BALL = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .3'><freejoint/>"
    "<geom size='.1'/></body></worldbody></mujoco>"
)


def draw(model: mujoco.MjModel, **request: object) -> workload_sampling.Sample:
    default = SampleRequest(4, 10, starts=StartPlan())
    return workload_sampling.draw(model, dataclasses.replace(default, **request))  # type: ignore[arg-type]


def window(sample: workload_sampling.Sample) -> Window:
    assert sample.starts.window is not None
    return sample.starts.window


def test_a_model_without_a_keyframe_stands_where_it_would_fall() -> None:
    falling = draw(BALL, starts=starts.KEYFRAME_STARTS)
    standing = draw(BALL)
    assert falling.observation.work.contacts == 0
    assert falling.starts == Starts(0.0, 0.0)
    assert standing.observation.work.contacts == 1
    assert standing.starts == Starts(starts.DEFAULT_SETTLE_S, starts.DEFAULT_SETTLE_S)


def test_starts_differ_and_follow_from_the_seed(model: mujoco.MjModel) -> None:
    first, again, other = (draw(model, seed=seed).workload for seed in (3, 3, 4))
    assert first.digest() == again.digest() != other.digest()
    assert len(np.unique(first.initial_state, axis=0)) == 4


def test_starts_are_spread_over_a_run_as_long_again(model: mujoco.MjModel) -> None:
    sample = draw(model, nbatch=5, starts=StartPlan(settle_s=0.2))
    time_s = sample.workload.initial_state[:, 0]
    # each is stepped once more
    np.testing.assert_allclose(time_s, [0.202, 0.242, 0.282, 0.322, 0.362])


def test_a_start_has_the_warm_start_of_the_state_before(model: mujoco.MjModel) -> None:
    row = draw(model).workload.initial_state[0]
    place = compat.state_columns(model)["qacc_warmstart"]
    data = mujoco.MjData(model)
    compat.set_state(model, data, row)
    mujoco.mj_forward(model, data)
    assert np.any(row[place] != 0)
    assert np.any(row[place] != data.qacc)


def test_the_cost_of_steps_bounds_the_run() -> None:
    max_nstep = starts.max_settling_nstep(step_s=0.02)
    assert max_nstep == 100
    sample = draw(BALL, max_settling_nstep=max_nstep)
    assert sample.starts == Starts(0.1, 5.0, SettleLimit.COST)
    assert starts.max_settling_nstep(step_s=100.0) == 2


def test_a_model_that_diverges_while_it_settles_starts_at_its_keyframe() -> None:
    xml = (
        "<mujoco><option timestep='.01' integrator='Euler'/><worldbody><body>"
        "<joint type='slide' stiffness='4.1e4'/><geom size='.1' mass='1'/></body></worldbody>"
        "</mujoco>"
    )
    sample = draw(mujoco.MjModel.from_xml_string(xml), nstep=2, starts=StartPlan(settle_s=3.0))
    assert sample.starts == Starts(0.0, 3.0, SettleLimit.DIVERGED)
    assert sample.observation.healthy.all()


@pytest.mark.parametrize(
    ("name", "contacts"),
    [
        ("cartpole", (0, 0)),
        ("cube_table", (8, 8)),
        ("cloth", (60, 75)),
        ("gripper", (8.5, 9.5)),
        ("humanoid", (5, 8)),
        ("muscle_arm", (0, 0)),
        ("pick_and_place", (11, 13)),
        ("quadruped_terrain", (2, 4)),
    ],
)
def test_shipped_models_settle_into_what_they_are_to_show(
    name: str, contacts: tuple[float, float]
) -> None:
    sample = draw(models.load(models.resolve(name)), nbatch=4)
    assert contacts[0] <= sample.observation.work.contacts <= contacts[1]
    assert sample.starts.limit is None


def test_a_settled_step_costs_what_it_costs_where_the_model_has_landed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    states: list[np.ndarray | None] = []

    def step_s(model: mujoco.MjModel, state: np.ndarray | None = None) -> float:
        states.append(state)
        return 1e-5

    monkeypatch.setattr(reference_run, "step_s", step_s)
    assert workload_sampling.settled_step_s(BALL) == 1e-5
    before, settled = states
    assert before is None
    assert settled[3] == pytest.approx(0.1, abs=1e-2)  # time, x, y, and the ball's height


def test_the_window_says_what_was_stepped() -> None:
    assert window(draw(BALL, nbatch=3)) == Window(3, 10, contacts=1.0)


def test_a_model_that_does_other_work_later_is_known_to() -> None:
    falling = draw(BALL, starts=StartPlan(settle_s=0.05))
    assert window(falling).contacts == 0
    assert window(falling).later == Later(pytest.approx(10.0), 1.0)


def test_later_work_is_not_looked_for_where_steps_are_slow() -> None:
    slow = draw(BALL, starts=StartPlan(settle_s=0.05), max_settling_nstep=100)
    assert window(slow).later is None


def test_a_solver_at_its_limit_is_seen() -> None:
    xml = (
        "<mujoco><option iterations='1' tolerance='0'/><worldbody><geom type='plane'"
        " size='1 1 1'/><body pos='0 0 .1'><freejoint/><geom size='.1'/></body></worldbody>"
        "</mujoco>"
    )
    assert window(draw(mujoco.MjModel.from_xml_string(xml))).solver_limited == 1.0


def test_a_height_field_without_heights_is_seen() -> None:
    xml = (
        "<mujoco><asset><hfield name='h' nrow='4' ncol='4' size='1 1 1 .1'/></asset><worldbody>"
        "<geom type='hfield' hfield='h'/><body pos='0 0 .1'><freejoint/><geom size='.1'/></body>"
        "</worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    assert window(draw(model)).flat_hfields == 1
    model.hfield_data[5] = 0.1
    assert window(draw(model)).flat_hfields == 0


SLEEPER = mujoco.MjModel.from_xml_string(
    "<mujoco><option><flag sleep='enable'/></option><worldbody><geom type='plane' size='1 1 1'/>"
    "<body pos='0 0 .1'><freejoint/><geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>"
)


def test_what_slept_is_awake_at_a_restored_state() -> None:
    assert window(draw(SLEEPER)).asleep_in_run == 1.0
    assert window(draw(SLEEPER)).asleep == 0.0
    assert window(draw(BALL)).asleep is None


def test_what_slept_sleeps_again_after_a_lead_in() -> None:
    sample = draw(SLEEPER, lead_in=workload_sampling.LEAD_IN, perturbs=False)
    assert window(sample).asleep == 1.0
    assert (window(sample).nstep, sample.workload.nstep) == (10, 10 + workload_sampling.LEAD_IN)
    assert sample.observation.work.contacts == 0


def test_unperturbed_starts_of_a_resting_model_rest() -> None:
    columns = compat.state_columns(BALL)["qvel"]
    perturbed, resting = (
        np.abs(draw(BALL, perturbs=perturbs).workload.initial_state[:, columns]).max()
        for perturbs in (True, False)
    )
    assert resting < 1e-6 < 1e-3 < perturbed
