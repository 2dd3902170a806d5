"""Sources of overhead: real code, each computing what its cheaper form computes."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from mjbench.loop import habits, overhead
from mjbench.simulation import models

NSTEP = 20
FILE = str(models.resolve("cartpole").path)


@pytest.fixture(scope="module")
def cartpole() -> Any:
    return models.load(models.resolve("cartpole"))


@pytest.mark.parametrize("source", habits.HABITS, ids=lambda s: s.name)
def test_a_source_steps_as_the_bare_loop_does(source: habits.Habit, cartpole: Any) -> None:
    if source.name == "state set":
        pytest.skip("it puts the state back in every step, which is what it is timed for")
    bare = habits.loop(habits.Habit("time", "pass", value="data.time"), cartpole, NSTEP)
    bare.run()
    again = habits.loop(replace(source, value="data.time"), cartpole, NSTEP, FILE)
    again.run()
    assert again.value() == bare.value() == pytest.approx(NSTEP * cartpole.opt.timestep)


@pytest.mark.parametrize("source", [s for s in habits.HABITS if s.cheaper], ids=lambda s: s.name)
def test_the_cheaper_form_computes_the_same(source: habits.Habit, cartpole: Any) -> None:
    values = []
    for one in (source, habits.find(source.cheaper)):
        made = habits.loop(one, cartpole, NSTEP, FILE)
        made.run()
        values.append(np.array(made.value()))
    assert np.array_equal(*values)


def test_names_are_unique_and_cheaper_forms_exist() -> None:
    names = [source.name for source in habits.HABITS]
    assert len(names) == len(set(names))
    assert {s.cheaper for s in habits.HABITS if s.cheaper} <= set(names)


def test_a_callback_does_not_outlive_its_loop(cartpole: Any) -> None:
    habits.loop(habits.find("callback from Python"), cartpole, NSTEP).run()
    assert mujoco.get_mjcb_control() is None


def test_the_engines_clock_is_on_again_after_its_loop(cartpole: Any) -> None:
    habits.loop(habits.find("engine clock off"), cartpole, NSTEP).run()
    assert mujoco.get_mjcb_time() is None


def test_what_is_shown_runs_as_a_script(cartpole: Any) -> None:
    for source in habits.HABITS:
        names = {"mujoco": mujoco, "np": np, "nstep": NSTEP, "mj_step": mujoco.mj_step}
        names |= {"model": cartpole, "data": mujoco.MjData(cartpole), "file": FILE}
        names |= {
            "joint_name": "slider",
            "joint_id": 0,
            "spec": mujoco.mjtState.mjSTATE_INTEGRATION,
        }
        exec(habits.code(source), names)
        assert names["data"].time > 0 or source.name == "state set"


def test_a_model_whose_joints_have_no_names_has_no_access_by_name() -> None:
    pile = models.load(models.resolve("pile"))
    kept = [s for s in habits.HABITS if habits.available(s, pile)]
    assert "named access by name" not in {s.name for s in kept}
    assert "named access by id" in {s.name for s in kept}
    habits.loop(habits.find("hoisted accessor"), pile, 2).run()


def test_a_model_without_actuators_has_no_controls_to_write() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    kept = {s.name for s in habits.HABITS if habits.available(s, model)}
    assert not any(name.startswith("control") for name in kept)


def test_the_table_has_every_source_with_its_cheaper_form() -> None:
    table = overhead.measure(models.resolve("cartpole"), launches=2)
    assert {c.source for c in table.costs} == {
        s.name for s in habits.HABITS if s.name not in ("bare loop", overhead.BINDING)
    }
    for cost in table.costs:
        assert cost.low <= cost.ns <= cost.high
        assert (cost.saved_ns is None) == (not cost.cheaper)
        assert "mj_step(model, data" in cost.code
    assert table.bare_ns > 0
    assert table.nstep > 0
