"""Other contacts than C's: which are close, and which are a fault."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjbench.commands.compare.accelerated_contacts import ContactJudge
from mjbench.simulation import compat
from mjbench.simulation.accelerated_judgement import EngineAnswer, PairContacts, Precision
from mjbench.simulation.constraint_problem import ConstraintProblem
from mjbench.simulation.contacts import Contacts

BOX = "<geom type='box' size='0.1 0.1 0.1'/>"
BALL = "<geom size='0.1'/>"
LIMIT = 1e-6
NO_CONTACTS = Contacts.of([], [], [], [], [])


def resting(geom: str, height: float, speed: float = 0.0) -> ConstraintProblem:
    """Return the problem of a body on a plane, which slides along x where it has a speed."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='1 1 1'/>"
        f"<body pos='0 0 {height}'><freejoint/>{geom}</body></worldbody></mujoco>"
    )
    data, state = mujoco.MjData(model), np.empty(compat.state_size(model))
    data.qvel[0] = speed
    compat.get_state(model, data, state)
    problem = ConstraintProblem(model)
    problem.load(state, np.empty(0))
    return problem


def judged(problem: ConstraintProblem, contacts: Contacts) -> PairContacts:
    return judged_states(problem, [contacts])


def judged_states(problem: ConstraintProblem, states: Sequence[Contacts]) -> PairContacts:
    """Judge what an engine finds each time that it takes the same state."""
    judge = ContactJudge(problem.model, Precision.FLOAT64)
    for contacts in states:
        judge.add(problem, contacts)
    (pair,) = judge.pairs(LIMIT)
    return pair


def moved(contacts: Contacts, by_m: float) -> Contacts:
    return replace(contacts, position=contacts.position + by_m * np.array([1.0, 0.0, 0.0]))


def test_the_contacts_of_c_agree() -> None:
    problem = resting(BOX, 0.0995)
    pair = judged(problem, problem.contacts)
    assert (pair.types, pair.answer) == (("plane", "box"), EngineAnswer.YES)
    assert (pair.count, pair.other_counts, pair.position_m) == (4.0, 0, 0.0)


def test_other_points_of_boxes_are_close_and_say_how_far_they_are() -> None:
    problem = resting(BOX, 0.0995)
    pair = judged(problem, moved(problem.contacts, 1e-4))
    assert pair.answer == EngineAnswer.CLOSE
    assert pair.position_m == pytest.approx(1e-4)
    assert "up to 0.1 mm elsewhere" in str(pair)


def test_points_of_boxes_that_change_accelerations_much_are_a_fault() -> None:
    problem = resting(BOX, 0.0995)
    assert judged(problem, moved(problem.contacts, 0.2)).answer == EngineAnswer.NO


def test_a_point_that_is_lacking_is_a_fault() -> None:
    problem = resting(BOX, 0.0995)
    pair = judged(problem, problem.contacts.select(np.arange(3)))
    assert (pair.answer, pair.other_counts) == (EngineAnswer.NO, 1)
    assert "3 contacts instead of 4 (other numbers in 1 of 1 states)" in str(pair)


def test_a_ball_on_a_plane_has_one_answer() -> None:
    problem = resting(BALL, 0.0995)
    assert judged(problem, moved(problem.contacts, 1e-2)).answer == EngineAnswer.NO
    assert judged(problem, moved(problem.contacts, 1e-7)).answer != EngineAnswer.NO


def test_a_capsule_on_a_plane_has_one_answer_but_for_the_axes_of_its_friction() -> None:
    problem = resting("<geom type='capsule' size='0.1 0.2' euler='80 0 0'/>", 0.1342, speed=0.01)
    contacts = problem.contacts
    assert len(contacts.simulation) == 1
    cosine, sine = np.cos(0.3), np.sin(0.3)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])
    turned = judged(problem, replace(contacts, frame=turn @ contacts.frame))
    assert turned.answer == EngineAnswer.CLOSE
    assert "tangents turned by up to 17°" in str(turned)
    assert judged(problem, moved(contacts, 1e-2)).answer == EngineAnswer.NO


def test_a_contact_that_just_begins_to_touch_is_left_out() -> None:
    problem = resting(BALL, 0.1 - 1e-12)
    judge = ContactJudge(problem.model, Precision.FLOAT64)
    judge.add(problem, problem.contacts.select(np.array([], dtype=int)))
    assert judge.pairs(LIMIT) == ()


def test_a_ball_that_loses_its_plane_in_two_of_thirty_states_is_a_fault() -> None:
    problem = resting(BALL, 0.0995)
    pair = judged_states(problem, [problem.contacts] * 28 + [NO_CONTACTS] * 2)
    assert (pair.answer, pair.effect, pair.other_counts) == (EngineAnswer.NO, 0.0, 2)
    assert "in one state by 1e+02 %" in str(pair)


def test_a_box_that_lacks_a_point_in_two_of_thirty_states_is_a_fault() -> None:
    problem = resting(BOX, 0.0995)
    lacking = problem.contacts.select(np.arange(3))
    assert judged_states(problem, [problem.contacts] * 28 + [lacking] * 2).answer == EngineAnswer.NO


def test_a_pair_that_never_touches_in_c_is_a_fault() -> None:
    problem, touching = resting(BOX, 0.5), resting(BOX, 0.0995)
    pair = judged(problem, touching.contacts)
    assert (pair.answer, pair.effect) == (EngineAnswer.NO, None)
    assert "in 1 state of geoms that never touch in C" in str(pair)


def test_a_touch_of_geoms_that_never_touch_in_c_is_no_fault_where_it_is_hardly_one() -> None:
    problem = resting(f"{BOX}<geom type='box' size='0.1 0.1 0.1' pos='0 0 1'/>", 0.0995)
    corner = problem.contacts.select(np.array([0]))
    other = np.array([[corner.geom[0, 0], 2]])

    def with_touch(depth_m: float) -> Contacts:
        touch = replace(corner, geom=other, distance=np.array([-depth_m]))
        return Contacts.together(problem.contacts, touch)

    states = [problem.contacts] * 29
    pair = judged_states(problem, [*states, with_touch(1e-6)])
    assert (pair.answer, pair.unmet, pair.effect) == (EngineAnswer.CLOSE, 1, 0.0)
    assert judged_states(problem, [*states, with_touch(1e-3)]).answer == EngineAnswer.NO
    assert judged_states(problem, [with_touch(1e-6)] * 9).answer == EngineAnswer.NOT_JUDGED


def test_contacts_beside_a_flex_are_not_judged() -> None:
    problem = resting(BOX, 0.0995)
    flex = replace(problem.contacts.select(np.array([0])), geom=np.array([[-1, 0]]))
    problem.contacts = Contacts.together(problem.contacts, flex)
    judge = ContactJudge(problem.model, Precision.FLOAT64)
    judge.add(problem, problem.contacts)
    assert {pair.answer for pair in judge.pairs(LIMIT)} == {EngineAnswer.NOT_JUDGED}
    assert all("beside a flex, which C cannot be given" in str(p) for p in judge.pairs(1))
