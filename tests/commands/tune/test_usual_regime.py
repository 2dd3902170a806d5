"""What is seen of a model, and which bodies are said never to touch."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from tuning_models import GEOMETRY, ROD_GAP_M, rods

from mjbench.commands.tune import usual_regime
from mjbench.commands.tune.usual_regime import ObservedModel, observe_model
from mjbench.simulation import geom_pairs, model_options, models


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usual_regime, "OBSERVED_S", 2.0)
    monkeypatch.setattr(usual_regime, "NPOSE", 200)


def observe(xml: str) -> ObservedModel:
    return observe_model(mujoco.MjModel.from_xml_string(xml), is_mjcf=True)


def pairs(seen: ObservedModel) -> set[frozenset[str]]:
    return {frozenset((pair.body1, pair.body2)) for pair in seen.idle_pairs}


def test_rods_that_spin_beside_each_other_never_touch() -> None:
    seen = observe(rods(10, 20))
    assert pairs(seen) == {frozenset((f"a{i}", f"b{k}")) for i in range(10) for k in range(20)}
    closest_m = min(pair.closest_m for pair in seen.idle_pairs if pair.closest_m is not None)
    assert closest_m == pytest.approx(ROD_GAP_M, abs=1e-4)
    assert seen.max_contacts == 0
    assert seen.simulated_s == pytest.approx(2.0, rel=0.1)
    assert seen.nposes == 200


def test_pairs_that_the_engine_filters_are_not_listed() -> None:
    exclude = "<contact><exclude body1='a0' body2='b0'/></contact>"
    assert pairs(observe(rods(1, 2).replace("</mujoco>", f"{exclude}</mujoco>"))) == {
        frozenset(("a0", "b1"))
    }


def test_a_body_without_a_name_is_counted_and_not_listed() -> None:
    seen = observe(rods(1, 2).replace("name='b1'", ""))
    assert pairs(seen) == {frozenset(("a0", "b0"))}
    assert seen.unnamed_idle_pairs == 1


# Two parallel arms that lie diagonally beside each other; nothing moves them.
ARMS = "<mujoco><option gravity='0 0 0'/><worldbody>{}{}</worldbody>".format(
    *(
        f"<body name='{name}' pos='0 {y} 0' euler='0 0 45'><joint name='{name}' axis='0 0 1'/>"
        "<geom type='capsule' size='.02' fromto='0 0 0 .8 0 0'/></body>"
        for name, y in (("a", 0.0), ("b", 0.3))
    )
)


def test_what_touches_only_in_some_pose_is_not_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    assert observe(f"{ARMS}</mujoco>").idle_pairs == ()
    monkeypatch.setattr(usual_regime, "NPOSE", 0)
    assert pairs(observe(f"{ARMS}</mujoco>")) == {frozenset(("a", "b"))}


def test_what_touches_in_another_keyframe_is_not_idle() -> None:
    # equality constraints rule out random poses
    fixed = f"{ARMS}<equality><joint joint1='a'/></equality>"
    away = observe(f"{fixed}</mujoco>")
    assert pairs(away) == {frozenset(("a", "b"))}
    assert away.nposes == 0
    keys = "<keyframe><key qpos='0 0'/><key qpos='0 -1.5'/></keyframe>"
    assert observe(f"{fixed}{keys}</mujoco>").idle_pairs == ()


@pytest.mark.parametrize(
    ("joint", "is_idle"),
    [
        ("<joint type='slide' range='0 .01' limited='true'/>", True),
        ("<joint type='slide'/>", False),
        ("<freejoint/>", False),
    ],
)
def test_loose_bodies_are_never_idle(joint: str, is_idle: bool) -> None:
    # overlapping boxes, far from touching: but what is loose may go anywhere
    plate = f"{joint}<geom type='box' size='1 1 .01'/>"
    bodies = (
        f"<body name='a' euler='30 0 0'>{plate}</body>"
        f"<body name='b' pos='0 0 .5' euler='30 0 0'>{plate}</body>"
    )
    xml = f"<mujoco><option gravity='0 0 0'/><worldbody>{bodies}</worldbody></mujoco>"
    assert pairs(observe(xml)) == ({frozenset(("a", "b"))} if is_idle else set())


def test_pairs_that_the_broad_phase_parts_are_not_listed() -> None:
    # flat plates above each other: their bounding spheres overlap, their boxes do not
    plate = "<joint axis='0 0 1'/><geom type='box' size='1 1 .01'/>"
    bodies = f"<body name='a'>{plate}</body><body name='b' pos='0 0 .5'>{plate}</body>"
    assert observe(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>").idle_pairs == ()


def test_without_a_distance_function_pairs_have_no_distance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(mujoco, "mj_geomDistance")
    assert [pair.closest_m for pair in observe(rods(1, 1)).idle_pairs] == [None]


def test_iterations_are_those_that_bounds_would_cut() -> None:
    model = models.load(models.resolve("humanoid"))
    free = observe_model(model, is_mjcf=True)
    assert free.solver.most > 2 and free.line_search.most > 2
    assert free.solver.median <= free.solver.most
    model.opt.iterations, model.opt.ls_iterations = 2, 2
    bound = observe_model(model, is_mjcf=True)
    assert (bound.solver.most, bound.line_search.most) == (2, 2)


def test_the_cost_of_steps_bounds_what_is_observed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usual_regime.workload_sampling, "settled_step_s", lambda model: 0.05)
    seen = observe(rods(1, 1))
    assert seen.simulated_s < 0.25  # about 100 steps of 2 ms
    assert seen.nposes == 19


def test_seeds_decide_what_is_seen() -> None:
    model = mujoco.MjModel.from_xml_string(rods(1, 1))
    first, again = (observe_model(model, is_mjcf=True, seed=3) for _ in range(2))
    assert first.idle_pairs == again.idle_pairs
    assert first.solver == again.solver


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.xml", "<?xml version='1.0'?><!-- c --><mujoco/>", True),
        ("a.xml", "<robot name='r'/>", False),
        ("a.xml", "no XML", False),
        ("a.urdf", "<robot name='r'/>", False),
        ("a.mjb", "<mujoco/>", False),
    ],
)
def test_mjcf_is_recognised_by_its_root(
    tmp_path: Path, name: str, text: str, expected: bool
) -> None:
    (tmp_path / name).write_text(text)
    assert usual_regime.is_mjcf(tmp_path / name) is expected


def test_filters_are_those_of_the_engine() -> None:
    model = mujoco.MjModel.from_xml_string(GEOMETRY)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)  # all geoms overlap, so what can collide does
    touching = {
        tuple(sorted(map(int, geoms)))
        for geoms in zip(data.contact.geom1, data.contact.geom2, strict=True)
    }
    listed = {tuple(sorted(map(int, geoms))) for geoms in geom_pairs.read(model).geoms}
    assert listed == touching
    assert len(listed) > 3


def test_filters_follow_the_flags() -> None:
    model = mujoco.MjModel.from_xml_string(GEOMETRY)
    before = len(geom_pairs.read(model).geoms)
    model_options.set_flag(model.opt, "filterparent", "disable")
    assert len(geom_pairs.read(model).geoms) > before
    model_options.set_flag(model.opt, "contact", "disable")
    assert len(geom_pairs.read(model).geoms) == 0


def test_poses_lie_within_limits_or_a_tenth_beyond() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><compiler autolimits='true' angle='radian'/><worldbody><body><freejoint/>"
        "<geom size='.1'/><body><joint type='slide' range='0 1'/><geom size='.1'/>"
        "<body><joint type='ball' range='0 .5'/><geom size='.1'/><body><joint/>"
        "<geom size='.1'/></body></body></body></body></worldbody></mujoco>"
    )
    start = np.array(mujoco.MjData(model).qpos)
    start[:3] = 4.0, 5.0, 6.0
    poses = np.array(list(usual_regime.random_poses(model, start, 500, np.random.default_rng(0))))
    np.testing.assert_array_equal(poses[:, :7], np.tile(start[:7], (500, 1)))
    assert -0.1 <= poses[:, 7].min() < 0.0 and 1.0 < poses[:, 7].max() <= 1.1
    np.testing.assert_allclose(np.linalg.norm(poses[:, 8:12], axis=1), 1.0)
    assert 2 * np.arccos(poses[:, 8].min()) <= 0.56
    assert poses[:, 12].min() < -3.0 and poses[:, 12].max() > 3.0
