"""record(): what it returns, that every row is a copy, and how it refuses wrong names."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

import mjbench
from mjbench import record
from mjbench.commands.record.recording import Ragged
from mjbench.errors import InputError
from mjbench.simulation import compat, models, workload


def opened(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = models.load(models.resolve(name))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def by_hand(
    model: mujoco.MjModel, data: mujoco.MjData, nstep: int, read: Any, ctrl: Any = None
) -> list[Any]:
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
def test_rows_equal_those_of_a_careful_loop(field: str, read: Any) -> None:
    model, data = opened("cartpole")
    recorded = record(model, data, 30, [field])[field]
    model, data = opened("cartpole")
    expected = np.array(by_hand(model, data, 30, read))
    assert recorded.shape == expected.shape
    assert np.array_equal(recorded, expected)


def test_no_row_is_a_view_of_what_changes_later() -> None:
    model, data = opened("cube_table")
    names = ["qpos", "qvel", "time", "contact.dist", "efc_force", "body:drop_cube.xpos"]
    recorded = record(model, data, 20, names)
    before = {k: np.array(v.values if isinstance(v, Ragged) else v) for k, v in recorded.items()}
    for _ in range(50):
        mujoco.mj_step(model, data)
    for name, values in recorded.items():
        now = values.values if isinstance(values, Ragged) else values
        assert np.array_equal(now, before[name]), name
        assert not np.shares_memory(now, data.qpos)
    assert len(np.unique(recorded["time"])) == 20


def test_contacts_are_ragged_and_come_with_ncon() -> None:
    model, data = opened("cube_table")
    recorded = record(model, data, 60, ["contact.dist", "contact.pos", "time"])
    assert set(recorded) == {"contact.dist", "contact.pos", "ncon", "time"}
    dist = recorded["contact.dist"]
    assert len(dist) == 60
    assert np.array_equal(dist.counts, recorded["ncon"])
    model, data = opened("cube_table")
    expected = by_hand(model, data, 60, lambda d: d.contact.dist[: d.ncon])
    for step, (got, want) in enumerate(zip(dist, expected, strict=True)):
        assert np.array_equal(got, want)
        assert np.array_equal(dist[step], want)
    assert recorded["contact.pos"][-1].shape == (recorded["ncon"][-1], 3)


def test_constraint_rows_come_with_nefc() -> None:
    model, data = opened("cube_table")
    recorded = record(model, data, 10, ["efc_force"])
    assert np.array_equal(recorded["efc_force"].counts, recorded["nefc"])


def test_controls_and_a_policy_are_applied_before_each_step() -> None:
    model, data = opened("cartpole")
    controls = np.linspace(-1, 1, 40)[:, None] * np.ones(model.nu)
    recorded = record(model, data, 40, ["qpos"], controls=controls)["qpos"]
    model, data = opened("cartpole")
    assert np.array_equal(recorded, by_hand(model, data, 40, lambda d: d.qpos, controls))
    model, data = opened("cartpole")
    times = iter(range(40))
    again = record(model, data, 40, ["qpos"], policy=lambda m, d: controls[next(times)])["qpos"]
    assert np.array_equal(again, recorded)


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("qpso", "did you mean qpos"),
        ("site:pole_tp.xpos", "did you mean pole_tip"),
        ("site:pole_tip.xps", "did you mean xpos"),
        ("joints:hinge.qpos", "did you mean joint"),
        ("contact", "contact.dist"),
        ("contact.distance", "did you mean dist"),
        ("efc_forces", "did you mean efc_force"),
        ("sensor:angle", "pole_angle"),
        ("solver", "neither an array nor a number"),
        ("efc_J", "whose size is not nefc"),
        ("dof_island", "allocated anew in every step"),
    ],
)
def test_a_wrong_name_is_refused_with_a_suggestion_or_the_choices(field: str, message: str) -> None:
    model, data = opened("cartpole")
    with pytest.raises(InputError) as caught:
        record(model, data, 5, [field])
    assert message in str(caught.value)
    assert data.time == 0.0


def test_a_policy_may_write_the_controls_itself() -> None:
    model, data = opened("cartpole")

    def policy(model: mujoco.MjModel, data: mujoco.MjData) -> None:
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
def test_impossible_arguments_are_refused(wrong: dict[str, Any]) -> None:
    model, data = opened("cartpole")
    with pytest.raises(InputError):
        record(model, data, **{"nstep": 5, "fields": ["qpos"], **wrong})


def test_no_step_gives_empty_arrays() -> None:
    model, data = opened("cube_table")
    recorded = record(model, data, 0, ["qpos", "contact.pos"])
    assert recorded["qpos"].shape == (0, model.nq)
    assert recorded["contact.pos"].values.shape[0] == 0


SAME_MOMENT_FIELDS = [
    ["xpos", "site:pole_tip.xpos"],
    ["contact.dist", "qpos"],
    ["sensordata"],
    ["cvel", "subtree_com"],
    ["qacc", "body:torso.xpos"],
    ["qpos", "qvel", "time"],
]


@pytest.mark.parametrize("fields", SAME_MOMENT_FIELDS)
def test_a_row_of_one_moment_is_what_forward_computes_of_its_state(fields: list[str]) -> None:
    name = "cartpole" if "pole_tip" in " ".join(fields) else "humanoid"
    model = models.load(models.resolve(name))
    fields = [f for f in fields if not f.startswith("body:") or name == "humanoid"]
    data, again = workload.start_data(model), workload.start_data(model)
    log = mjbench.record(model, data, 30, [*fields, "xfrc_applied"], same_moment=True)
    spec, now = compat.INTEGRATION, mujoco.MjData(model)
    state = np.empty(compat.state_size(model, spec))
    for i in range(30):
        mujoco.mj_step(model, again)
        compat.get_state(model, again, state, spec)
        compat.set_state(model, now, state, spec)
        mujoco.mj_forward(model, now)
        for field in fields:
            expected = _read(model, now, field)
            np.testing.assert_array_equal(log[field][i], expected, err_msg=f"{field} {i}")
    np.testing.assert_array_equal(data.qpos, again.qpos)
    np.testing.assert_array_equal(data.qacc_warmstart, again.qacc_warmstart)


def _read(model: mujoco.MjModel, data: mujoco.MjData, field: str) -> np.ndarray:
    if field == "contact.dist":
        return data.contact.dist
    if ":" in field:
        kind, _, element = field.partition(":")
        element, _, attribute = element.partition(".")
        return getattr(getattr(data, kind)(element), attribute)
    return getattr(data, field)


def test_by_default_a_row_holds_two_moments() -> None:
    model = models.load(models.resolve("cartpole"))
    data = workload.start_data(model)
    mixed = mjbench.record(model, data, 2, ["qpos", "sensordata"])
    angle = mixed["qpos"][:, 1]
    assert mixed["sensordata"][1, 0] == angle[0] != angle[1]
    data = workload.start_data(model)
    alike = mjbench.record(model, data, 2, ["qpos", "sensordata"], same_moment=True)
    np.testing.assert_array_equal(alike["sensordata"][:, 0], alike["qpos"][:, 1])


@pytest.mark.parametrize(
    ("nstep", "fields", "message"),
    [
        (1, ["actuator:.x"], "no actuator ''"),
        (1, [5], "a field is a name, such as 'qpos', not 5"),
        ("5", ["qpos"], "nstep must be a whole number, at least 0, not '5'"),
        (1e3, ["qpos"], "nstep must be a whole number"),
    ],
)
def test_what_is_no_field_or_number_is_bad_input(
    nstep: Any, fields: list[Any], message: str
) -> None:
    model = models.load(models.resolve("cartpole"))
    with pytest.raises(InputError, match=re.escape(message)):
        mjbench.record(model, workload.start_data(model), nstep, fields)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("fields", value) for value in (None, 3, "qpos", {"qpos": 1}, object())),
        *((name, value) for name in ("model", "data") for value in (None, 3, "cartpole")),
        *(("policy", value) for value in (3, "", [3])),
        *(("controls", value) for value in ("", {"a": 1}, object())),
    ],
)
def test_arguments_of_another_type_are_bad_input(name: str, value: Any) -> None:
    model = models.load(models.resolve("cartpole"))
    usual = {"model": model, "data": mujoco.MjData(model), "nstep": 2, "fields": ["qpos"]}
    with pytest.raises(InputError, match=f"{name} must be "):
        mjbench.record(**usual | {name: value})
