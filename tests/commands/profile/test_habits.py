"""The table of habits: names, cheaper forms, and what a model must have."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjbench.commands.profile import habits
from mjbench.commands.profile.habits import Habit, compile_loop, loop_names, script
from mjbench.simulation import models

NSTEP = 20
FILE = str(models.resolve("cartpole").path)


@pytest.fixture(scope="module")
def cartpole() -> mujoco.MjModel:
    return models.load(models.resolve("cartpole"))


@pytest.mark.parametrize("habit", habits.HABITS, ids=lambda h: h.name)
def test_a_habit_steps_as_the_bare_loop_does(habit: Habit, cartpole: mujoco.MjModel) -> None:
    if habit.name == "state set":
        pytest.skip("it puts the state back in every step, which is what it is timed for")
    bare = compile_loop(Habit("time", "pass", value="data.time"), cartpole, NSTEP)
    bare.run()
    loop = compile_loop(replace(habit, value="data.time"), cartpole, NSTEP, FILE)
    loop.run()
    assert loop.value() == bare.value() == pytest.approx(NSTEP * cartpole.opt.timestep)


@pytest.mark.parametrize("habit", [h for h in habits.HABITS if h.cheaper], ids=lambda h: h.name)
def test_the_cheaper_form_computes_the_same(habit: Habit, cartpole: mujoco.MjModel) -> None:
    values = []
    for form in (habit, habits.BY_NAME[habit.cheaper]):
        loop = compile_loop(form, cartpole, NSTEP, FILE)
        loop.run()
        values.append(np.array(loop.value()))
    assert np.array_equal(*values)


def test_a_callback_does_not_outlive_its_loop(cartpole: mujoco.MjModel) -> None:
    compile_loop(habits.BY_NAME["callback from Python"], cartpole, NSTEP).run()
    assert mujoco.get_mjcb_control() is None


def test_the_engines_clock_is_on_again_after_its_loop(cartpole: mujoco.MjModel) -> None:
    compile_loop(habits.CLOCK_OFF, cartpole, NSTEP).run()
    assert mujoco.get_mjcb_time() is None


def test_the_printed_loop_runs_as_a_script(cartpole: mujoco.MjModel) -> None:
    for habit in habits.HABITS:
        names = loop_names(cartpole, NSTEP, FILE)
        exec(script(habit), names)
        assert names["data"].time > 0 or habit.name == "state set"


def test_a_model_whose_joints_have_no_names_is_accessed_by_its_first_joint() -> None:
    pile = models.load(models.resolve("pile"))
    names = loop_names(pile, 2, "")
    assert (names["joint_id"], names["joint_name"]) == (0, "")
    compile_loop(habits.BY_NAME["hoisted accessor"], pile, 2).run()


def available(model: mujoco.MjModel) -> set[str]:
    return {habit.name for habit in habits.HABITS if habit.requires(model, "")}


def test_a_model_whose_joints_have_no_names_has_no_access_by_name() -> None:
    names = available(models.load(models.resolve("pile")))
    assert "named access by name" not in names
    assert "named access by id" in names


def test_a_model_without_actuators_has_no_controls_to_write() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    assert not any(name.startswith("control") for name in available(model))
    assert any(
        name.startswith("control") for name in available(models.load(models.resolve("cartpole")))
    )
