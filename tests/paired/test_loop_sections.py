"""The plain loop in sections does exactly what the plain loop does."""

import dataclasses
import functools

import mujoco
import numpy as np
import pytest

from mjbench import paths
from mjbench.errors import MachineError
from mjbench.paired import loop_sections
from mjbench.paths import Resources
from mjbench.simulation import compat, models, workload
from mjbench.simulation.workload import Workload

FULL = compat.INTEGRATION


@pytest.fixture(scope="module")
def pile() -> Workload:
    """Contacts and warm-started solvers: a state that is not whole would show."""
    model = models.load(models.resolve("pile"))
    return workload.make(model, nbatch=3, nstep=10, hold=2, seed=1)


def states_along(pile: Workload) -> np.ndarray:
    """Return (nbatch * ncontrol, nstate): where the plain loop is after each control."""
    data, states = mujoco.MjData(pile.model), []
    for start, controls in zip(pile.initial_state, pile.control, strict=True):
        compat.set_state(pile.model, data, start, FULL)
        for values in controls:
            data.ctrl[:] = values
            mujoco.mj_step(pile.model, data, pile.hold)
            states.append(np.empty_like(start))
            compat.get_state(pile.model, data, states[-1], FULL)
    return np.array(states)


@pytest.mark.parametrize("count", [2, 4, 15])
def test_each_section_ends_where_the_plain_loop_does(pile: Workload, count: int) -> None:
    states, resources = states_along(pile), Resources(pile)
    (data,) = resources.datas(1)
    state = np.empty(states.shape[1])
    sections = loop_sections.sections(resources, count)
    assert len(sections) == count
    for index, section in enumerate(sections):
        for _ in range(2):  # again, from where it ended
            section.warm_up()
            section.run()
            section.check()
            compat.get_state(pile.model, data, state, FULL)
            assert np.array_equal(state, states[round((index + 1) * len(states) / count) - 1])


def test_a_section_that_ends_elsewhere_is_refused(pile: Workload) -> None:
    resources = Resources(pile)
    (data,) = resources.datas(1)
    for section in loop_sections.sections(resources, 4):
        section.warm_up()
        section.run()
        data.qvel[0] += 1e-9
        with pytest.raises(MachineError, match="do not end where the run does"):
            section.check()


def test_all_sections_leave_the_final_states_of_the_path(pile: Workload) -> None:
    resources = Resources(pile)
    prepared = paths.find("python_loop").prepare(pile, {}, resources)
    expected = prepared.verified_states().values.copy()
    prepared.clear()
    sections = loop_sections.sections(resources, 4)
    assert np.array_equal(resources.final_state(), expected)
    prepared.clear()
    for section in sections:
        section.warm_up()
        section.run()
    assert np.array_equal(resources.final_state(), expected)


def test_a_section_takes_its_share_of_the_steps_after_as_many_to_warm_up(
    pile: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    section, steps, mj_step = loop_sections.sections(Resources(pile), 5)[2], [], mujoco.mj_step
    monkeypatch.setattr(
        mujoco, "mj_step", lambda model, data: (steps.append(data), mj_step(model, data))
    )
    section.warm_up()
    assert len(steps) == pile.steps // 5
    section.run()
    assert len(steps) == 2 * pile.steps // 5


def test_a_run_whose_states_are_not_whole_is_not_divided(
    pile: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert loop_sections.can_divide(pile, 6)
    without_warmstart = compat.FULLPHYSICS
    size = compat.state_size(pile.model, without_warmstart)
    get_state = functools.partial(compat.get_state, spec=without_warmstart)
    monkeypatch.setattr(compat, "INTEGRATION", without_warmstart)
    monkeypatch.setattr(compat, "get_state", get_state)
    part = dataclasses.replace(pile, initial_state=pile.initial_state[:, :size].copy())
    assert not loop_sections.can_divide(part, 6)


def test_a_run_whose_states_lack_something_only_in_its_middle_is_not_divided(
    pile: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    mj_step, hidden = mujoco.mj_step, {"count": 0}

    def step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Kick at every fourth step of a simulation, which no state counts."""
        hidden["count"] = 0 if data.time == 0 else hidden["count"] + 1
        if hidden["count"] == 4:
            data.qvel[0] += 1e-6
        mj_step(model, data)

    monkeypatch.setattr(mujoco, "mj_step", step)
    timeless = dataclasses.replace(pile, initial_state=pile.initial_state.copy())
    timeless.initial_state[:, 0] = 0.0  # so that `step` sees each start
    assert loop_sections.can_divide(timeless, 3)  # whole simulations
    assert not loop_sections.can_divide(timeless, 15)


def test_a_run_that_must_be_reset_is_not_divided(
    pile: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_sections.compat, "has_sleep", lambda model: True)
    assert not loop_sections.can_divide(pile, 6)


def test_a_run_of_one_control_is_not_divided(pile: Workload) -> None:
    one = pile.first(1).only(np.array([True, False, False]))
    assert not loop_sections.can_divide(one, 6)


def test_no_control_is_divided(pile: Workload) -> None:
    assert loop_sections.can_divide(pile.first(1), 100)  # one for each simulation
