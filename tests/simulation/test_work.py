from typing import Any

import mujoco
import pytest

from mjbench.simulation import models, trajectory, work, workload


def test_the_counters_are_those_of_the_engine(model: Any) -> None:
    made = workload.make(model, nbatch=1, nstep=4)
    seen = work.observe(made)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, made.initial_state[0], int(mujoco.mjtState.mjSTATE_INTEGRATION))
    contacts = constraints = 0
    for u in made.control[0]:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        contacts += data.ncon
        constraints += data.nefc
    assert seen.work.contacts == contacts / 4 > 0
    assert seen.work.constraints == constraints / 4
    assert seen.work.solver_iterations > 0
    assert seen.start_contacts == 4
    assert seen.healthy.all()


def test_a_simulation_that_raises_a_warning_is_not_healthy() -> None:
    xml = (
        "<mujoco><option timestep='.1'/><worldbody><body><joint type='slide' stiffness='1e9'/>"
        "<geom size='.1' mass='.001'/></body></worldbody></mujoco>"
    )
    made = workload.make(mujoco.MjModel.from_xml_string(xml), nbatch=3, nstep=50)
    seen = work.observe(made)
    assert not seen.healthy.any()
    assert "BAD" in seen.diagnosis()


def test_facts_of_a_model_are_told_by_name(model: Any) -> None:
    facts = work.describe(model)
    assert (facts["nq"], facts["nv"], facts["nu"], facts["na"]) == (8, 7, 1, 0)
    assert (facts["integrator"], facts["solver"]) == ("euler", "newton")
    assert facts["contacts"] == 4
    assert facts["timestep"] == pytest.approx(0.002)


def test_peaks_are_the_most_of_any_step() -> None:
    made = workload.make(models.load(models.resolve("cube_table")), 3, 10, hold=2)
    found = work.observe(made).peaks
    run = trajectory.run(made, made.nbatch)
    singles = trajectory.single_steps(made, run, 10**6, rounded=False)
    assert found.contacts == singles.contacts.counts(len(singles.state)).max() > 0
    assert found.constraints == singles.constraints.max() > 0
