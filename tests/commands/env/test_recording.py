"""What an environment asks of the engine, and whether a plain loop does it."""

from typing import Any

import example_environments as examples
import mujoco
import numpy as np
import pytest

from mjbench.commands.env.adapters import adapt
from mjbench.commands.env.passes import EnvironmentPasses
from mjbench.commands.env.recording import EngineWatch, Moment, Recording

NSTEP = 40


def recorded(environment: Any, nstep: int = NSTEP) -> Recording:
    adapter = adapt(environment)
    watch = EngineWatch()
    passes = EnvironmentPasses(adapter, adapter.draw_actions(nstep, 0), 0)
    passes.recorded(watch, lambda: None)
    return watch.recording()


@pytest.mark.parametrize(
    ("environment", "calls", "checked"),
    [
        (examples.make(), (("mj_step", 4),), NSTEP),
        (examples.dm_control(), (("mj_step2", 1), ("mj_step", 3), ("mj_step1", 0)), 2 * NSTEP),
        (examples.robosuite(), (("mj_step1", 0), ("mj_step2", 1)) * 4, 4 * NSTEP),
    ],
    ids=["gymnasium", "dm_control", "robosuite"],
)
def test_every_call_is_repeated_by_a_plain_step(
    environment: Any, calls: tuple[tuple[str, int], ...], checked: int
) -> None:
    recording = recorded(environment)
    assert len(recording.steps) == NSTEP
    assert (recording.checked, recording.difference) == (checked, None)
    for trace in recording.steps:
        assert trace.calls == calls
        assert trace.nstep == 4
        assert trace.control.shape == (4, 1)
        assert not trace.written
        assert not trace.entered
    assert recording.obstacle == ""
    assert recording.changes == []


def test_a_step_begins_where_the_one_before_ended() -> None:
    first, second, *_ = recorded(examples.make()).steps
    assert (first.follows, second.follows) == (False, True)
    columns = [i for i in range(len(first.end)) if i != _ctrl_column()]
    assert np.array_equal(first.end[columns], second.start[columns])


def _ctrl_column() -> int:
    from mjbench.simulation import compat

    model = mujoco.MjModel.from_xml_string(examples.XML)
    return compat.state_columns(model)["ctrl"].start


def test_a_controller_sets_another_control_for_each_step() -> None:
    trace = recorded(examples.robosuite()).steps[0]
    assert len(np.unique(trace.control)) == 4


def test_fields_that_are_written_are_named() -> None:
    between = recorded(examples.WritesBetween()).steps[1]
    before = recorded(examples.Mocap()).steps[1]
    assert between.written == {"qvel"}
    assert (before.written, before.entered) == (frozenset(), {"mocap_pos"})


def test_changes_of_the_model_are_named_with_their_moment() -> None:
    steps = recorded(examples.NewGravity())
    assert {(c.field, c.moment) for c in steps.changes} == {
        ("opt.gravity", Moment.STEP),
        ("opt.gravity", Moment.RESET),
    }
    assert steps.difference is None  # each step is repeated with the model that it had
    resets = recorded(examples.NewMass())
    assert [(c.field, c.moment, c.count) for c in resets.changes] == [
        ("body_mass", Moment.RESET, 2)
    ]


def test_the_model_of_most_steps_is_kept_as_it_was() -> None:
    environment = examples.NewMass()
    recording = recorded(environment, nstep=17)  # 15 steps of the first episode, 2 of the second
    assert recording.version == 0
    assert recording.model.body_mass[2] != environment.model.body_mass[2]


def test_a_step_that_a_plain_loop_does_not_repeat_is_found() -> None:
    recording = recorded(examples.StaleStart())
    assert recording.difference is not None
    number, difference = recording.difference
    assert number == 0
    assert difference.field == "qpos"


def test_what_no_plain_loop_can_do_is_said() -> None:
    assert "threads of its own" in recorded(examples.Threaded()).obstacle

    class Two(examples.Env):
        def do_simulation(self, action: np.ndarray) -> None:
            super().do_simulation(action)
            mujoco.mj_step(self.model, mujoco.MjData(self.model))

    assert "several simulations" in recorded(Two()).obstacle

    class Euler(examples.Env):
        def do_simulation(self, action: np.ndarray) -> None:
            mujoco.mj_forward(self.model, self.data)
            mujoco.mj_Euler(self.model, self.data)

    assert "mj_Euler" in recorded(Euler()).obstacle


def test_a_callback_of_the_engine_is_an_obstacle() -> None:
    environment = examples.make()
    mujoco.set_mjcb_control(lambda model, data: None)
    try:
        assert "mjcb_control" in recorded(environment, 3).obstacle
    finally:
        mujoco.set_mjcb_control(None)


def test_an_environment_that_does_not_step_the_engine_has_no_traces() -> None:
    forwards, nothing = recorded(examples.Forwards()), recorded(examples.NoPhysics())
    assert set(forwards.steps) == set(nothing.steps) == {None}
    assert (forwards.other_calls, nothing.other_calls) == (True, False)
    assert forwards.model is None


def test_the_environment_does_what_it_does_unwatched() -> None:
    environment = examples.make()
    adapter = adapt(environment)
    passes = EnvironmentPasses(adapter, adapter.draw_actions(NSTEP, 0), 0)
    watched = passes.recorded(EngineWatch(), lambda: None)
    step = mujoco.mj_step
    assert passes.plain().returned.differences(watched.returned) == []
    assert mujoco.mj_step is step
