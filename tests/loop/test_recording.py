"""record(): what it returns, that every row is a copy, and what it says of wrong names."""

from typing import Any

import mujoco
import numpy as np
import pytest

import mjbench
from mjbench import record
from mjbench.errors import InputError
from mjbench.loop.recording import Ragged
from mjbench.simulation import models


def opened(name: str) -> tuple[Any, Any]:
    model = models.load(models.resolve(name))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def by_hand(model: Any, data: Any, nstep: int, read: Any, ctrl: Any = None) -> list[Any]:
    rows = []
    for i in range(nstep):
        if ctrl is not None:
            data.ctrl[:] = ctrl[i]
        mujoco.mj_step(model, data)
        rows.append(np.array(read(data)))
    return rows


FIXED = [
    ("qpos", lambda d: d.qpos),
    ("qvel", lambda d: d.qvel),
    ("time", lambda d: d.time),
    ("xpos", lambda d: d.xpos),
    ("sensordata", lambda d: d.sensordata),
    ("ncon", lambda d: d.ncon),
    ("site:pole_tip.xpos", lambda d: d.site("pole_tip").xpos),
    ("site:pole_tip", lambda d: d.site("pole_tip").xpos),
    ("joint:hinge.qpos", lambda d: d.joint("hinge").qpos),
    ("joint:hinge.qvel", lambda d: d.joint("hinge").qvel),
    ("sensor:pole_angle", lambda d: d.sensor("pole_angle").data),
    ("body:pole.xquat", lambda d: d.body("pole").xquat),
]


@pytest.mark.parametrize(("field", "read"), FIXED, ids=[f for f, _ in FIXED])
def test_rows_are_what_a_careful_loop_keeps(field: str, read: Any) -> None:
    model, data = opened("cartpole")
    found = record(model, data, 30, [field])[field]
    model, data = opened("cartpole")
    expected = np.array(by_hand(model, data, 30, read))
    assert found.shape == expected.shape
    assert np.array_equal(found, expected)


def test_no_row_is_a_view_of_what_changes_later() -> None:
    model, data = opened("cube_table")
    names = ["qpos", "qvel", "time", "contact.dist", "efc_force", "body:drop_cube.xpos"]
    found = record(model, data, 20, names)
    kept = {k: np.array(v.values if isinstance(v, Ragged) else v) for k, v in found.items()}
    for _ in range(50):
        mujoco.mj_step(model, data)
    for name, values in found.items():
        now = values.values if isinstance(values, Ragged) else values
        assert np.array_equal(now, kept[name]), name
        assert not np.shares_memory(now, data.qpos)
    assert len(np.unique(found["time"])) == 20


def test_the_lessons_bug_is_real_and_record_does_not_have_it() -> None:
    """200 steps from `tilted`: x of the tip ranges over 0.2269 m, or over nothing in views."""
    model, data = opened("cartpole")
    tip = record(model, data, 200, ["site:pole_tip.xpos"])["site:pole_tip.xpos"][:, 0]
    assert np.ptp(tip) == pytest.approx(0.2269, abs=5e-5)
    model, data = opened("cartpole")
    views = []
    for _ in range(200):
        mujoco.mj_step(model, data)
        views.append(data.site("pole_tip").xpos)
    assert np.ptp([view[0] for view in views]) == 0.0


def test_contacts_come_as_a_ragged_record_with_their_number() -> None:
    model, data = opened("cube_table")
    found = record(model, data, 60, ["contact.dist", "contact.pos", "time"])
    assert set(found) == {"contact.dist", "contact.pos", "ncon", "time"}
    dist = found["contact.dist"]
    assert len(dist) == 60
    assert np.array_equal(dist.counts, found["ncon"])
    model, data = opened("cube_table")
    expected = by_hand(model, data, 60, lambda d: d.contact.dist[: d.ncon])
    for step, (got, want) in enumerate(zip(dist, expected, strict=True)):
        assert np.array_equal(got, want)
        assert np.array_equal(dist[step], want)
    assert found["contact.pos"][-1].shape == (found["ncon"][-1], 3)


def test_constraint_rows_come_with_theirs() -> None:
    model, data = opened("cube_table")
    found = record(model, data, 10, ["efc_force"])
    assert np.array_equal(found["efc_force"].counts, found["nefc"])


def test_controls_and_a_policy_are_applied_before_each_step() -> None:
    model, data = opened("cartpole")
    controls = np.linspace(-1, 1, 40)[:, None] * np.ones(model.nu)
    found = record(model, data, 40, ["qpos"], controls=controls)["qpos"]
    model, data = opened("cartpole")
    assert np.array_equal(found, by_hand(model, data, 40, lambda d: d.qpos, controls))
    model, data = opened("cartpole")
    times = iter(range(40))
    again = record(model, data, 40, ["qpos"], policy=lambda m, d: controls[next(times)])["qpos"]
    assert np.array_equal(again, found)


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ("qpso", "near: qpos"),
        ("site:pole_tp.xpos", "near: pole_tip"),
        ("site:pole_tip.xps", "near: xpos"),
        ("joints:hinge.qpos", "near: joint"),
        ("contact", "contact.dist"),
        ("contact.distance", "near: dist"),
        ("efc_forces", "near: efc_force"),
        ("sensor:angle", "pole_angle"),
        ("solver", "neither an array nor a number"),
        ("efc_J", "whose size is not nefc"),
        ("dof_island", "made anew in every step"),
    ],
)
def test_a_wrong_name_is_told_with_near_ones(field: str, said: str) -> None:
    model, data = opened("cartpole")
    with pytest.raises(InputError) as caught:
        record(model, data, 5, [field])
    assert said in str(caught.value)
    assert data.time == 0.0


def test_a_policy_may_write_the_controls_itself() -> None:
    model, data = opened("cartpole")

    def policy(model: Any, data: Any) -> None:
        data.ctrl[:] = 0.5

    record(model, data, 3, ["ctrl"], policy=policy)
    assert (data.ctrl == 0.5).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"controls": np.zeros((3, 1))},
        {"controls": np.zeros((5, 1)), "policy": lambda m, d: 0.0},
        {"fields": ["qpos", "qpos"]},
        {"nstep": -1},
    ],
)
def test_what_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    model, data = opened("cartpole")
    with pytest.raises(InputError):
        record(model, data, **{"nstep": 5, "fields": ["qpos"], **wrong})


def test_no_step_gives_empty_arrays() -> None:
    model, data = opened("cube_table")
    found = record(model, data, 0, ["qpos", "contact.pos"])
    assert found["qpos"].shape == (0, model.nq)
    assert found["contact.pos"].values.shape[0] == 0


def test_it_is_at_hand_as_mjbench_record() -> None:
    assert mjbench.record is record
