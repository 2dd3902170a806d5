import mujoco
import numpy as np
import pytest

from mjbench.simulation import compat, models, reference_run, reference_trajectory, workload


def test_the_counters_are_those_of_the_engine(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=1, nstep=4)
    observation = reference_run.observe(sample)
    data = mujoco.MjData(model)
    mujoco.mj_setState(
        model, data, sample.initial_state[0], int(mujoco.mjtState.mjSTATE_INTEGRATION)
    )
    contacts = constraints = 0
    for u in sample.control[0]:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        contacts += data.ncon
        constraints += data.nefc
    assert observation.work.contacts == contacts / 4 > 0
    assert observation.work.constraints == constraints / 4
    assert observation.work.solver_iterations > 0
    assert observation.start_contacts == 4
    assert observation.healthy.all()


def test_a_simulation_whose_numbers_explode_is_not_healthy() -> None:
    xml = (
        "<mujoco><option timestep='.1'/><worldbody><body><joint type='slide' stiffness='1e9'/>"
        "<geom size='.1' mass='.001'/></body></worldbody></mujoco>"
    )
    sample = workload.make(mujoco.MjModel.from_xml_string(xml), nbatch=3, nstep=50)
    observation = reference_run.observe(sample)
    assert not observation.healthy.any()
    assert "BAD" in observation.diagnosis()


# Two joints along the same line: MuJoCo calls their inertia matrix too close to singular.
SINGULAR_XML = (
    "<mujoco><worldbody><body><joint type='slide' axis='0 0 1'/>"
    "<joint type='slide' axis='0 1e-9 1'/><geom size='.1'/></body></worldbody></mujoco>"
)
# Forty violated joint limits, and memory for fewer constraints.
CONSTRAINTS_XML = (
    "<mujoco><size memory='20K'/><worldbody>"
    + "".join(
        f"<body pos='{i} 0 0'><joint type='slide' axis='0 0 1' limited='true' range='1 2'/>"
        "<geom size='.1'/></body>"
        for i in range(40)
    )
    + "</worldbody></mujoco>"
)
# Twelve balls in one place, and memory for fewer contacts.
CONTACTS_XML = (
    "<mujoco><size memory='24K'/><option gravity='0 0 0'/><worldbody>"
    + "".join(
        f"<body pos='0 0 {i}e-3'><freejoint/><geom size='.1' margin='1' gap='10'/></body>"
        for i in range(12)
    )
    + "</worldbody></mujoco>"
)


@pytest.mark.parametrize(
    ("xml", "warning"),
    [(SINGULAR_XML, "INERTIA"), (CONSTRAINTS_XML, "CNSTRFULL"), (CONTACTS_XML, "CONTACTFULL")],
    ids=["inertia", "constraints", "contacts"],
)
def test_a_warning_that_leaves_the_state_sound_is_no_divergence(xml: str, warning: str) -> None:
    sample = workload.make(mujoco.MjModel.from_xml_string(xml), nbatch=3, nstep=20)
    observation = reference_run.observe(sample)
    assert observation.healthy.all()
    assert observation.other_warnings()[warning] == 3
    assert observation.diagnosis() == ""


def test_only_warnings_of_bad_numbers_mean_divergence() -> None:
    names = np.array(compat.warning_names())
    diverged = names[compat.divergence_warnings()]
    assert sorted(diverged) == ["BADCTRL", "BADQACC", "BADQPOS", "BADQVEL"]


def test_a_final_state_that_is_not_finite_has_diverged(
    model: mujoco.MjModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_state = compat.get_state

    def lose_the_last(m: mujoco.MjModel, d: mujoco.MjData, out: np.ndarray) -> None:
        get_state(m, d, out)
        if out[0] > start_time_s:
            out[1] = np.inf

    sample = workload.make(model, nbatch=2, nstep=3)
    start_time_s = sample.initial_state[0, 0]
    monkeypatch.setattr(compat, "get_state", lose_the_last)
    observation = reference_run.observe(sample)
    assert not observation.healthy.any()
    assert observation.diagnosis() == "a final state that is not finite in 2"


def test_describe_returns_sizes_and_names(model: mujoco.MjModel) -> None:
    facts = reference_run.describe(model)
    assert (facts.nq, facts.nv, facts.nu, facts.na) == (8, 7, 1, 0)
    assert (facts.integrator, facts.solver, facts.cone) == ("euler", "newton", "pyramidal")
    assert facts.contacts == 4
    assert facts.timestep == pytest.approx(0.002)


def test_peaks_are_the_maxima_over_all_steps() -> None:
    sample = workload.make(models.load(models.resolve("cube_table")), 3, 10, hold=2)
    peaks = reference_run.observe(sample).peaks
    run = reference_trajectory.record_trajectory(sample, sample.nbatch)
    singles = reference_trajectory.single_steps(sample, run, 10**6, rounded=False)
    assert peaks.contacts == singles.contacts.counts(len(singles.state)).max() > 0
    assert peaks.constraints == singles.constraints.max() > 0
