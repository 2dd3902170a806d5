"""Derivatives of a step that a script computes column by column."""

import pytest
from linted import findings

SETUP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
eps = 1e-6
def state():
    return np.concatenate([data.qpos, data.qvel])
def next_state(x, u):
    data.qpos[:], data.qvel[:] = x[:model.nq], x[model.nq : model.nq + model.nv]
    data.ctrl[:] = u
    mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])
"""
ONE_SIDED = """
for i in range(model.nu):
    mujoco.mj_setState(model, data, start, spec)
    data.ctrl[i] += eps
    mujoco.mj_step(model, data)
    B[:, i] = (state() - following) / eps
"""
CENTRED = """
for i in range(model.nu):
    data.qpos[:], data.qvel[:] = qpos, qvel
    data.ctrl[i] = ctrl[i] + eps
    mujoco.mj_step(model, data)
    above = state()
    data.qpos[:], data.qvel[:] = qpos, qvel
    data.ctrl[i] = ctrl[i] - eps
    mujoco.mj_step(model, data)
    B[:, i] = (above - state()) / (2 * eps)
"""
TANGENT = """
for i in range(model.nv):
    mujoco.mj_copyData(data, model, origin)
    move = np.zeros(model.nv)
    move[i] = eps
    mujoco.mj_integratePos(model, data.qpos, move, 1)
    mujoco.mj_step(model, data)
    mujoco.mj_differentiatePos(model, move, eps, qpos, data.qpos)
    A[: model.nv, i] = move
"""
VELOCITIES = """
for i in range(model.nv):
    mujoco.mj_copyData(data, model, origin)
    data.qvel[i] += eps
    mujoco.mj_step(model, data)
    A[model.nv :, model.nv + i] = (data.qvel - qvel) / eps
"""
HELPER = """
def linearized(x, u):
    for i in range(len(x)):
        other = x.copy()
        other[i] += eps
        A[:, i] = (next_state(other, u) - next_state(x, u)) / eps
    return A
"""


@pytest.mark.parametrize("text", [ONE_SIDED, CENTRED, HELPER])
def test_a_step_for_each_column_is_found(text: str) -> None:
    (finding,) = findings(SETUP + text, "MJB020")
    assert "mjd_transitionFD" in finding.message
    assert finding.last_line is not None


def test_positions_and_velocities_are_found_together() -> None:
    assert len(findings(SETUP + TANGENT + VELOCITIES, "MJB020")) == 2
    assert findings(SETUP + TANGENT, "MJB020") == []
    assert findings(SETUP + VELOCITIES, "MJB020") == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    mujoco.mj_step(model, data)\n", "    mujoco.mj_step(model, data, 5)\n"),
        ("    mujoco.mj_step(model, data)\n", "    mujoco.mj_step(model, data)\n" * 2),
        ("    mujoco.mj_step(", "    for _ in range(9): mujoco.mj_step("),
        ("data.ctrl[i] += eps", "model.body_mass[i] += eps"),
        ("data.ctrl[i] += eps", "data.xfrc_applied[i] += eps"),
        ("state() - following", "data.site_xpos[0] - following"),
        ("    mujoco.mj_setState(model, data, start, spec)\n", ""),
        (" / eps", ""),
        ("B[:, i]", "gradient[i]"),
        ("eps = 1e-6", "eps = 1e-6\nmodel.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4"),
        ("eps = 1e-6", "eps = 1e-6\nmujoco.mjd_transitionFD(model, data, eps, 0, A, B, C, D)"),
    ],
)
def test_what_is_no_derivative_of_one_step_is_no_finding(old: str, new: str) -> None:
    text = SETUP + ONE_SIDED
    assert old in text
    assert findings(text.replace(old, new), "MJB020") == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return np.concatenate([data.qpos, data.qvel])", "return cost(data.qpos)"),
        ("return np.concatenate([data.qpos, data.qvel])", "return data.qpos**2"),
        ("data.ctrl[:] = u", "data.ctrl[:] = -u @ data.qpos"),
        ("data.ctrl[:] = u", "model.geom_friction[:] = u"),
    ],
)
def test_what_follows_from_the_next_state_is_no_finding(old: str, new: str) -> None:
    assert findings((SETUP + HELPER).replace(old, new), "MJB020") == []
