"""Properties of the shipped models, checked with MuJoCo alone; mjbench is not imported."""

import mujoco
import numpy as np
import pytest
from commands import ROOT

FOLDER = ROOT / "models"
NAMES = sorted(path.stem for path in FOLDER.glob("*.xml"))


def load(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a shipped model and its data at keyframe 0, after mj_forward."""
    model = mujoco.MjModel.from_xml_path(str(FOLDER / f"{name}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def normal_forces(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
    """Return the normal force of each contact, in N."""
    force, normal = np.zeros(6), []
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        normal.append(float(force[0]))
    return normal


def bodies_in_contact(model: mujoco.MjModel, data: mujoco.MjData, floor: str) -> list[str]:
    """Return the bodies that touch the geom `floor`, one entry per contact."""
    ground = model.geom(floor).id
    pairs = [list(contact.geom) for contact in data.contact[: data.ncon]]
    others = [pair[1 - pair.index(ground)] for pair in pairs if ground in pair]
    return [model.body(model.geom_bodyid[geom]).name for geom in others]


# cartpole


def test_cartpole_has_its_documented_names_ids_and_masses() -> None:
    model, data = load("cartpole")
    assert (model.body("cart").id, model.body("pole").id) == (1, 2)
    assert (model.joint("slider").id, model.joint("hinge").id) == (0, 1)
    assert model.body("pole").mass[0] == pytest.approx(0.200)
    assert model.opt.timestep == 0.002
    assert model.key(0).name == "tilted"
    assert data.ncon == 0


# cube_table


def test_cubes_come_to_rest_on_four_contacts_each_that_carry_their_weight() -> None:
    model, data = load("cube_table")
    assert data.ncon == 4  # only the resting cube touches at the start
    mujoco.mj_step(model, data, 300)
    bodies = {"drop_cube": 0, "rest_cube": 0}
    for contact in data.contact[: data.ncon]:
        for geom in contact.geom:
            name = model.body(model.geom_bodyid[geom]).name
            bodies[name] = bodies.get(name, 0) + 1
    assert data.ncon == 8
    assert (bodies["drop_cube"], bodies["rest_cube"]) == (4, 4)
    assert [f"{f:.3f}" for f in normal_forces(model, data)] == ["1.226"] * 8
    assert [f"{1e3 * c.dist:.3f}" for c in data.contact[: data.ncon]] == ["-0.108"] * 8
    assert model.body("drop_cube").mass[0] == model.body("rest_cube").mass[0] == 0.5
    assert model.geom("floor").type[0] == mujoco.mjtGeom.mjGEOM_PLANE


# the others


def test_pick_and_place_has_thirty_degrees_of_freedom_and_objects_on_the_table() -> None:
    model, data = load("pick_and_place")
    assert model.nv == 30
    assert set(bodies_in_contact(model, data, "table")) == {"cube", "can", "bar"}


def test_the_humanoid_stands_on_both_feet() -> None:
    model, data = load("humanoid")
    assert (model.nv, model.nu) == (27, 21)
    assert set(bodies_in_contact(model, data, "floor")) == {"right_foot", "left_foot"}
    height = data.body("pelvis").xpos[2]
    mujoco.mj_step(model, data, 50)
    assert data.body("pelvis").xpos[2] == pytest.approx(height, abs=0.02)  # it does not jump


def test_the_quadruped_stands_on_terrain_that_its_range_finders_see() -> None:
    model, data = load("quadruped_terrain")
    rays = model.sensor_type == int(mujoco.mjtSensor.mjSENS_RANGEFINDER)
    assert model.nhfield == 1
    assert rays.sum() >= 8
    assert np.all(data.sensordata[model.sensor_adr[rays]] > 0)
    assert len(set(bodies_in_contact(model, data, "terrain"))) == 4


def test_the_muscle_arm_has_wrapping_tendons_and_activations() -> None:
    model, data = load("muscle_arm")
    assert model.na == 6
    assert model.ntendon == 6
    assert np.any(data.wrap_obj >= 0)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


def test_the_pile_is_a_hundred_boxes_in_hundreds_of_contacts() -> None:
    model, data = load("pile")
    free = model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)
    assert free.sum() == 100
    assert 300 <= data.ncon <= 800


def test_the_linkage_has_every_equality_and_a_mocap_body_away_from_its_default() -> None:
    model, data = load("linkage")
    kinds = {int(kind) for kind in model.eq_type}
    expected = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD, mujoco.mjtEq.mjEQ_JOINT)
    assert kinds == {int(kind) for kind in expected}
    assert np.abs(data.mocap_pos[0] - model.body("handle").pos).max() > 0.05


def test_the_cloth_is_a_flex_in_contact() -> None:
    model, data = load("cloth")
    assert model.nflex == 1
    assert data.ncon > 10


def test_the_gripper_holds_its_box_with_elliptic_cones() -> None:
    model, data = load("gripper")
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.impratio >= 10
    height = data.body("box").xpos[2]
    mujoco.mj_step(model, data, 500)
    assert data.body("box").xpos[2] == pytest.approx(height, abs=0.005)


def test_all_integrators_and_solvers_occur() -> None:
    options = [load(name)[0].opt for name in NAMES]
    integrators = mujoco.mjtIntegrator
    solvers = mujoco.mjtSolver
    assert {int(o.integrator) for o in options} >= {
        int(i) for i in (integrators.mjINT_EULER, integrators.mjINT_RK4,
                         integrators.mjINT_IMPLICITFAST)
    }  # fmt: skip
    assert {int(o.solver) for o in options} == {
        int(s) for s in (solvers.mjSOL_NEWTON, solvers.mjSOL_CG, solvers.mjSOL_PGS)
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_model_starts_from_a_keyframe_and_steps_without_a_warning(name: str) -> None:
    model, data = load(name)
    assert model.nkey >= 1
    mujoco.mj_step(model, data, 300)
    assert not np.any(data.warning.number)
    assert np.all(np.isfinite(data.qpos))


@pytest.mark.parametrize("name", NAMES)
def test_the_table_of_models_has_the_models_facts(name: str) -> None:
    text = (FOLDER / "README.md").read_text()
    (row,) = [line for line in text.splitlines() if line.startswith(f"| `{name}` |")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    model, data = load(name)
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower()
    solver = mujoco.mjtSolver(model.opt.solver).name.removeprefix("mjSOL_").lower()
    sizes = [str(n) for n in (model.nq, model.nv, model.nu, model.na)]
    assert cells[2:8] == [*sizes, integrator, solver]
    assert cells[8:10] == [str(data.ncon), str(data.nefc)]
