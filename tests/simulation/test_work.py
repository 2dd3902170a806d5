import mujoco
import pytest

from mjbench.simulation import models, trajectory, work, workload


def test_the_counters_are_those_of_the_engine(model: mujoco.MjModel) -> None:
    sample = workload.make(model, nbatch=1, nstep=4)
    observation = work.observe(sample)
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


def test_a_simulation_that_raises_a_warning_is_not_healthy() -> None:
    xml = (
        "<mujoco><option timestep='.1'/><worldbody><body><joint type='slide' stiffness='1e9'/>"
        "<geom size='.1' mass='.001'/></body></worldbody></mujoco>"
    )
    sample = workload.make(mujoco.MjModel.from_xml_string(xml), nbatch=3, nstep=50)
    observation = work.observe(sample)
    assert not observation.healthy.any()
    assert "BAD" in observation.diagnosis()


def test_describe_returns_sizes_and_names(model: mujoco.MjModel) -> None:
    facts = work.describe(model)
    assert (facts.nq, facts.nv, facts.nu, facts.na) == (8, 7, 1, 0)
    assert (facts.integrator, facts.solver, facts.cone) == ("euler", "newton", "pyramidal")
    assert facts.contacts == 4
    assert facts.timestep == pytest.approx(0.002)


def test_peaks_are_the_maxima_over_all_steps() -> None:
    sample = workload.make(models.load(models.resolve("cube_table")), 3, 10, hold=2)
    peaks = work.observe(sample).peaks
    run = trajectory.record_trajectory(sample, sample.nbatch)
    singles = trajectory.single_steps(sample, run, 10**6, rounded=False)
    assert peaks.contacts == singles.contacts.counts(len(singles.state)).max() > 0
    assert peaks.constraints == singles.constraints.max() > 0
