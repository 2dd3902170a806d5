"""How often a model evaluates the dynamics is a count of its integrator and its timestep."""

import mujoco
import pytest

from mjbench.commands.profile.evaluations import Evaluations


def test_rk4_evaluates_the_dynamics_four_times_a_step():
    model = mujoco.MjModel.from_xml_string('<mujoco><option integrator="RK4"/></mujoco>')
    assert Evaluations.of(model) == Evaluations("rk4", 4, 0.002)


@pytest.mark.parametrize(
    ("integrator", "of_step", "timestep", "begin"),
    [
        (
            "rk4",
            4,
            0.0005,
            "RK4 at 0.5 ms evaluates the dynamics 8,000 times in a simulated second, 16",
        ),
        ("euler", 1, 0.0005, "Euler at 0.5 ms evaluates the dynamics 2,000 times"),
    ],
)
def test_what_costs_is_named_with_its_factor(integrator, of_step, timestep, begin):
    assert Evaluations(integrator, of_step, timestep).sentence.startswith(begin)


def test_the_defaults_of_mujoco_are_not_worth_a_word():
    assert Evaluations("euler", 1, 0.002).sentence == ""
    assert Evaluations("rk4", 4, 0.01).sentence == ""
