"""Where a step's time goes: stages, and what a simulated second is made of."""

from typing import Any

import mujoco
import numpy as np
import pytest
from step_profiles import step_profile

from mjbench.commands.profile import measure as profile
from mjbench.commands.profile import rendering
from mjbench.commands.profile.rendering import FrameTime
from mjbench.results.json_form import json_form
from mjbench.simulation import engine_clock, models, workload


def test_a_second_of_simulated_time_is_physics_python_and_frames() -> None:
    assert step_profile().simulated_second == pytest.approx(
        {"physics": 500 * 2e-6, "Python": 500 * 1e-6, "rendering (egl)": 60 * 0.01}
    )


def test_json_has_what_was_measured_and_what_follows_from_it() -> None:
    document = json_form(step_profile())
    assert (document["status"], document["steps"]["python_ns"]) == ("ok", 1000.0)
    assert document["simulated_second"]["physics"] == pytest.approx(0.001)


def test_stages_are_shares_of_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    model = models.load(models.resolve("cube_table"))
    for has_clock in (engine_clock.has_clock, lambda model: False):
        monkeypatch.setattr(profile, "has_clock", has_clock)
        block = profile.Block(1, 20, lambda: workload.reset_to_start)
        stages = profile.timer_shares(model, block)
        assert sum(stages.values()) == pytest.approx(1.0)
        assert all(share >= 0 for share in stages.values())
        assert stages["constraint solver"] > 0


def test_steps_in_which_the_timers_are_reset_do_not_count() -> None:
    def started(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        workload.reset_to_start(model, data)
        data.timer.duration[:] = 1e9
        data.qvel[:] = np.nan

    model = models.load(models.resolve("cube_table"))
    stages = profile.timer_shares(model, profile.Block(1, 20, lambda: started))
    assert set(stages.values()) == {0.0, 1.0}


@pytest.mark.parametrize(("steps_s", "shares_s"), [(4.0, [2.0, 3.5]), (9.5, [])])
def test_frames_have_the_time_that_steps_leave(
    monkeypatch: pytest.MonkeyPatch, steps_s: float, shares_s: list[float]
) -> None:
    now_s, rendered_s = 0.0, list[float]()

    def call(*arguments: Any, **options: Any) -> Any:
        nonlocal now_s
        now_s += steps_s
        return step_profile().steps

    def render(model: Any, backend: str, limit_s: float, budget_s: float) -> FrameTime:
        nonlocal now_s
        now_s += 1.5
        rendered_s.append(budget_s)
        return FrameTime(backend, 0.01)

    monkeypatch.setattr(profile.isolate, "call", call)
    monkeypatch.setattr(rendering, "measure", render)
    monkeypatch.setattr(rendering, "BACKENDS", ("egl", "osmesa"))
    row = profile.measure(models.resolve("cartpole"), budget_s=10.0, clock=lambda: now_s)
    assert rendered_s == shares_s
    left_out = [frame.detail for frame in row.frames or () if frame.seconds is None]
    assert left_out == ["no time was left: give a longer --budget"] * (2 - len(shares_s))
