import pickle
from typing import Any

import mujoco
import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.simulation import compat, workload


def test_the_same_seed_gives_the_same_work_and_another_seed_another(model: mujoco.MjModel) -> None:
    digests = [workload.make(model, 4, 10, seed=s).digest() for s in (3, 3, 4)]
    assert digests[0] == digests[1] != digests[2]


def test_shapes_follow_batch_steps_and_hold(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=4, nstep=12, hold=3)
    nstate = compat.state_size(model)
    assert sample.initial_state.shape == (4, nstate)
    assert sample.control.shape == (4, 4, 1)
    assert sample.step_control.shape == (4, 12, 1)
    assert (sample.nbatch, sample.ncontrol, sample.nstep, sample.steps) == (4, 4, 12, 48)


def test_each_control_is_held_for_its_steps(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=2, nstep=6, hold=3)
    np.testing.assert_array_equal(sample.step_control[:, 0], sample.control[:, 0])
    np.testing.assert_array_equal(sample.step_control[:, 2], sample.control[:, 0])
    np.testing.assert_array_equal(sample.step_control[:, 3], sample.control[:, 1])


def test_starts_lie_around_the_keyframe_and_differ(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=50, nstep=1)
    columns = compat.state_columns(model)
    qpos = sample.initial_state[:, columns["qpos"]]
    assert np.abs(qpos - model.key_qpos[0]).max() < 10 * workload.START_POSITION_SD
    assert np.all(qpos.std(axis=0)[:3] > 0)
    np.testing.assert_allclose(np.linalg.norm(qpos[:, 3:7], axis=1), 1.0, atol=1e-12)


def test_starts_keep_the_keyframes_mocap_pose(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=2, nstep=1)
    columns = compat.state_columns(model)
    np.testing.assert_array_equal(sample.initial_state[0, columns["mocap_pos"]], [0, 0, 3])


def test_the_warm_start_is_real_and_matters(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=1, nstep=1)
    spec = compat.INTEGRATION
    warm = sample.initial_state[0]
    cold = warm.copy()
    cold[compat.state_columns(model, spec)["qacc_warmstart"]] = 0.0
    assert np.any(warm != cold)
    data = mujoco.MjData(model)
    accelerations = []
    for row in (warm, cold):
        compat.set_state(model, data, row, spec)
        mujoco.mj_step(model, data)
        accelerations.append(data.qacc.copy())
    assert np.any(accelerations[0] != accelerations[1])
    np.testing.assert_allclose(*accelerations, rtol=1e-6, atol=1e-6)


def test_controls_are_within_range_and_smooth(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=20, nstep=400)
    assert sample.control.min() >= -1
    assert sample.control.max() <= 1
    spread = sample.control.std()
    assert 0.1 < spread < 0.5
    assert np.abs(np.diff(sample.control, axis=1)).mean() < 0.5 * spread


def test_a_model_without_actuators_has_controls_of_width_zero() -> None:
    xml = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    sample = workload.make(mujoco.MjModel.from_xml_string(xml), 2, 5)
    assert sample.control.shape == (2, 5, 0)


@pytest.mark.parametrize(
    ("sizes", "word"),
    [((0, 5, 1), "nbatch"), ((2, 0, 1), "nstep"), ((2, 5, 0), "hold"), ((2, 5, 2), "multiple")],
)
def test_impossible_sizes_are_an_error_that_names_them(
    model: mujoco.MjModel, sizes: Any, word: str
) -> None:
    with pytest.raises(InputError, match=word):
        workload.make(model, *sizes)


def test_first_is_a_prefix_and_only_a_selection(small: workload.Workload) -> None:
    np.testing.assert_array_equal(small.first(2).control, small.control[:, :2])
    keep = np.array([True, False, True, True, False])
    np.testing.assert_array_equal(small.only(keep).initial_state, small.initial_state[keep])


def test_the_spread_scales_starts_and_controls_down_to_the_keyframe(model: mujoco.MjModel) -> None:
    columns = compat.state_columns(model)
    wide, narrow, none = (workload.make(model, 9, 30, spread=s) for s in (1.0, 0.1, 0.0))
    assert np.ptp(narrow.control) < 0.2 * np.ptp(wide.control)
    assert np.ptp(none.control) == 0.0
    assert np.ptp(none.initial_state[:, columns["qpos"]], axis=0).max() == 0.0


def test_a_portable_workload_is_restored_bit_by_bit(small: workload.Workload) -> None:
    portable = pickle.loads(pickle.dumps(workload.portable(small)))
    assert workload.restore(small.model, portable).digest() == small.digest()
    rows = np.array([3, 1])
    some = workload.restore(small.model, portable.only(rows, small.initial_state))
    np.testing.assert_array_equal(some.initial_state, small.initial_state[rows])
    np.testing.assert_array_equal(some.control, small.control[rows])


def test_a_workload_of_another_model_is_not_restored(small: workload.Workload) -> None:
    xml = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    with pytest.raises(InputError, match="the model has 0 controls, the workload 1"):
        workload.restore(mujoco.MjModel.from_xml_string(xml), workload.portable(small))
