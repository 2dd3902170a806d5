"""Distances in the units of the degrees of freedom, and as a share of the motion."""

import mujoco
import numpy as np
import pytest

from mjbench.commands.tune import accuracy
from mjbench.commands.tune.accuracy import Motion, Units
from mjbench.commands.tune.trajectories import Trajectories

SLIDE_AND_HINGE = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body><joint type="slide"/><joint type="hinge"/><geom size="1"/></body>
    </worldbody></mujoco>"""
)
FREE = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
)


def runs_of(qpos, qvel=None):
    qpos = np.asarray(qpos, dtype=float)
    velocities = np.zeros_like(qpos) if qvel is None else np.asarray(qvel, dtype=float)
    points = np.zeros((len(qpos), 4, 1))
    return Trajectories(qpos, velocities, points, points[..., :0], np.zeros(len(qpos), bool))


def test_slides_are_in_metres_and_hinges_in_radians():
    assert accuracy.angular(SLIDE_AND_HINGE).tolist() == [False, True]
    assert accuracy.angular(FREE).tolist() == [False] * 3 + [True] * 3


def test_the_largest_distance_of_a_run_counts():
    reference = runs_of(np.zeros((2, 3, 2)))
    runs = runs_of([[[0, 0], [0.3, 0], [0.1, 0]], [[0, 0], [0, 0.2], [0, 0]]])
    scale = Motion(accuracy.angular(SLIDE_AND_HINGE), Units(1.0, 2.0))
    shares = accuracy.shares(SLIDE_AND_HINGE, scale, runs, reference)
    assert shares.tolist() == pytest.approx([0.3, 0.1])
    apart = accuracy.distance(SLIDE_AND_HINGE, scale, runs, reference)
    assert apart.position == Units(pytest.approx(0.3), pytest.approx(0.2))
    assert apart.share == pytest.approx(0.3)


def test_orientations_differ_by_their_angle():
    identity = [0, 0, 0, 1, 0, 0, 0]
    turned = [0, 0, 0, np.cos(0.05), np.sin(0.05), 0, 0]
    runs, reference = (runs_of([[pose]], np.zeros((1, 1, 6))) for pose in (turned, identity))
    scale = Motion(accuracy.angular(FREE), Units(1.0, 1.0))
    apart = accuracy.distance(FREE, scale, runs, reference)
    assert apart.position.m == 0.0
    assert apart.position.rad == pytest.approx(0.1 / np.sqrt(3))  # of three degrees of freedom


def test_motion_is_the_farthest_from_the_start():
    runs = runs_of([[[0.0, 1.0], [2.0, 0.5]]])
    moved = accuracy.motion(SLIDE_AND_HINGE, np.zeros((1, 2)), runs)
    assert moved.position == Units(pytest.approx(2.0), pytest.approx(1.0))


def test_a_model_at_rest_has_a_least_motion():
    reference = runs_of(np.zeros((1, 1, 2)))
    runs = runs_of([[[1e-6, 0.0]]])
    scale = accuracy.motion(SLIDE_AND_HINGE, np.zeros((1, 2)), reference)
    share = accuracy.shares(SLIDE_AND_HINGE, scale, runs, reference)
    assert share.tolist() == pytest.approx([1e-6 / accuracy.LEAST_MOTION])


def test_nine_runs_in_ten_are_nearer():
    values = np.arange(1.0, 31.0)
    assert accuracy.bound(values) == 30.0
    assert accuracy.bound(np.arange(1.0, 65.0)) == 62.0


def test_the_bound_holds_of_nine_runs_in_ten_with_its_confidence():
    rng = np.random.default_rng(0)
    true_quantile = np.exp(1.2815515655)  # of a lognormal at 0.9
    holds = [accuracy.bound(rng.lognormal(size=64)) >= true_quantile for _ in range(2000)]
    assert np.mean(holds) > 0.94  # 0.95 or more, but for 2,000 draws
