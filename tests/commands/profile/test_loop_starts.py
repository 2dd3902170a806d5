"""Loops that start from many states of a file, in turns, with their controls held."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjbench
from mjbench.commands.profile import habit_timing, rendering
from mjbench.commands.profile import measure as profile
from mjbench.commands.profile.loop_starts import NSTART, LoopStarts
from mjbench.errors import InputError
from mjbench.simulation import compat, models, reference_run, workload_sampling
from mjbench.simulation.starts import StartPlan
from mjbench.simulation.workload_sampling import SampleRequest

CARTPOLE = models.load(models.resolve("cartpole"))


@pytest.fixture
def captured(tmp_path: Path) -> Path:
    """Return a file of captured states; the control of a state is its time."""
    data, file = mujoco.MjData(CARTPOLE), tmp_path / "states.npz"
    with mjbench.capture(file):
        for i in range(1000):
            data.ctrl[:] = 1e-3 * i
            mujoco.mj_step(CARTPOLE, data)
    return file


def test_starts_are_restored_in_turn_with_the_control_that_follows(captured: Path) -> None:
    starts, data = LoopStarts(CARTPOLE, StartPlan(file=captured), nstep=7), mujoco.MjData(CARTPOLE)
    assert starts.starts.file == "states.npz"
    assert starts.observation.healthy.sum() == NSTART
    start, times = starts.in_turn(repeats=2), []
    for _ in range(2 * NSTART + 2):
        start(CARTPOLE, data)
        step = round(data.time / CARTPOLE.opt.timestep)
        assert data.ctrl[0] == pytest.approx(1e-3 * step)
        times.append(data.time)
    assert times[0::2] == times[1::2]
    assert len(set(times)) == NSTART
    assert times[-1] == times[0]


def test_a_run_is_short_but_not_too_short(captured: Path) -> None:
    assert LoopStarts(CARTPOLE, StartPlan(file=captured)).nstep >= 5


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch, inline: None) -> None:
    """Start no process, and render nothing."""
    monkeypatch.setattr(rendering, "BACKENDS", ())


def test_a_profile_of_captured_states_says_so(captured: Path, brief: None) -> None:
    source = models.resolve("cartpole")
    steps = profile.measure(source, starts=StartPlan(file=captured), budget_s=0.05).steps
    assert steps.starts is not None and steps.starts.file == "states.npz"
    assert steps.run_nstep is not None and steps.run_nstep >= 5
    assert sum(steps.stages.values()) == pytest.approx(1.0)


def test_habits_cost_something_from_captured_states(captured: Path, brief: None) -> None:
    source, starts = models.resolve("cartpole"), StartPlan(file=captured)
    table = habit_timing.measure(source, launches=1, starts=starts, budget_s=0.05)
    assert table.starts is not None and table.starts.file == "states.npz"
    assert table.bare_ns > 0


def test_a_file_that_does_not_fit_is_bad_input(captured: Path, brief: None) -> None:
    for measure in (profile.measure, habit_timing.measure):
        with pytest.raises(InputError, match="holds states of another model, cartpole"):
            measure(models.resolve("humanoid"), starts=StartPlan(file=captured))


def test_states_without_controls_get_random_ones(tmp_path: Path) -> None:
    file = tmp_path / "states.npz"
    np.savez(file, qpos=np.zeros((5, 2)))
    starts, data = LoopStarts(CARTPOLE, StartPlan(file=file), nstep=3), mujoco.MjData(CARTPOLE)
    start, controls = starts.in_turn(), set()
    for _ in range(20):
        start(CARTPOLE, data)
        controls.add(float(data.ctrl[0]))
    assert starts.starts.controls_file is None
    assert len(controls) == 20


def test_without_a_file_starts_are_those_of_every_other_command() -> None:
    drawn = LoopStarts(CARTPOLE, StartPlan(), nstep=5)
    expected = workload_sampling.draw(CARTPOLE, SampleRequest(NSTART, 5, 5)).workload
    start, data = drawn.in_turn(), mujoco.MjData(CARTPOLE)
    for row, control in zip(expected.initial_state[:3], expected.control[:3, 0], strict=True):
        start(CARTPOLE, data)
        state = np.empty(len(row))
        compat.get_state(CARTPOLE, data, state)
        columns = compat.state_columns(CARTPOLE)
        np.testing.assert_array_equal(state[columns["qpos"]], row[columns["qpos"]])
        np.testing.assert_array_equal(data.ctrl, control)


def test_a_model_of_slow_steps_has_fewer_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference_run, "step_s", lambda model, state=None: 0.01)
    drawn = LoopStarts(CARTPOLE, StartPlan())
    assert (drawn.nstep, drawn.starts.window.nstart) == (5, 20)  # type: ignore[union-attr]
