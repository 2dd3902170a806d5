"""The same physics by other paths."""

import re
from typing import Any

import example_environments as examples
import numpy as np
import pytest

from mjbench.commands.env import physics_comparison
from mjbench.commands.env.adapters import adapt
from mjbench.commands.env.passes import EnvironmentPasses
from mjbench.commands.env.physics_comparison import (
    CHOICES,
    PATHS,
    PhysicsAlone,
    difference_from,
    physics_of,
)
from mjbench.commands.env.recording import EngineWatch
from mjbench.simulation import reference_run
from mjbench.status import Status
from mjbench.verification import selection
from mjbench.verification.path_verification import AgreementReport
from mjbench.verification.plan import Variant


class Channel:
    """Takes what a child says of its progress."""

    def doing(self, text: str, position: int | None = None) -> None:
        pass

    def allow_silence(self, seconds: float) -> None:
        pass


def compared(environment: Any, variants: tuple[Variant, ...]) -> Any:
    alone = physics(environment)
    assert isinstance(alone, PhysicsAlone)
    reports: list[AgreementReport] = []
    comparison = physics_comparison.prepare(
        alone,
        variants,
        lambda variant, report: reports.append(report),
        Channel(),  # type: ignore[arg-type]
    )
    return comparison, reports


def test_all_paths_agree_and_are_timed() -> None:
    variants = selection.variants(PATHS, [1, 2], CHOICES)
    comparison, reports = compared(examples.make(), variants)
    statuses = {report.status for report in reports}
    assert statuses <= {Status.OK, Status.UNAVAILABLE}  # an old release lacks some
    assert reports[0].status == Status.OK
    comparison.reorder(np.random.default_rng(0))
    for index in comparison.prepared:
        assert comparison.block_s(index) > 0
    assert comparison.differences == {}
    assert len(comparison.physics.numbers) == 40
    comparison.close()


def test_one_call_for_all_steps_needs_a_control_that_is_held() -> None:
    variants = (Variant("python_loop", {}), Variant("python_loop_hold", {}))
    comparison, reports = compared(examples.robosuite(), variants)
    assert [report.status for report in reports] == [Status.OK, Status.UNAVAILABLE]
    assert "another control for each step" in reports[1].detail
    comparison.close()


def test_a_path_that_is_wrong_gets_no_speed() -> None:
    variants = (Variant("python_loop", {}), Variant("wrong_paths:OneStepFewer", {}))
    comparison, reports = compared(examples.make(), variants)
    assert reports[1].status == Status.DISAGREES
    assert list(comparison.prepared) == [0]
    comparison.close()


def test_a_path_that_is_wrong_in_a_timed_block_is_found() -> None:
    variants = (Variant("python_loop", {}), Variant("wrong_paths:WrongWhenTimed", {}))
    comparison, _ = compared(examples.make(), variants)
    rng = np.random.default_rng(0)
    for _ in range(20):
        comparison.reorder(rng)
        comparison.block_s(1)
    assert list(comparison.differences) == [1]
    comparison.close()


def physics(environment: Any, nstep: int = 40, nthread: int = 2) -> PhysicsAlone | str:
    adapter = adapt(environment)
    watch = EngineWatch()
    passes = EnvironmentPasses(adapter, adapter.draw_actions(nstep, 0), 0)
    passes.recorded(watch, lambda: None)
    return physics_of(watch.recording(), 0, nthread)


@pytest.mark.parametrize(
    ("environment", "hold", "ncontrol"),
    [(examples.make(), 4, 5), (examples.dm_control(), 4, 5), (examples.robosuite(), 1, 20)],
    ids=["gymnasium", "dm_control", "robosuite"],
)
def test_a_plain_loop_reaches_the_states_of_the_environment(
    environment: Any, hold: int, ncontrol: int
) -> None:
    result = physics(environment)
    assert isinstance(result, PhysicsAlone)
    assert (result.workload.hold, result.workload.ncontrol) == (hold, ncontrol)
    assert (result.run, result.holds) == (5, hold == 4)
    assert result.workload.nstep == result.run * 4
    assert result.numbers.tolist() == list(range(40))
    reached = reference_run.observe(result.workload).final_state
    assert reached.tobytes() == result.final_state.tobytes()
    assert difference_from(result) == ""


def test_what_is_written_before_a_step_begins_a_run() -> None:
    result = physics(examples.Mocap())
    assert isinstance(result, PhysicsAlone)
    assert (result.run, result.workload.nbatch) == (1, 40)
    assert difference_from(result) == ""


def test_only_steps_of_one_model_are_compared() -> None:
    result = physics(examples.NewMass())
    assert isinstance(result, PhysicsAlone)
    assert result.numbers.tolist() == list(range(15))
    assert difference_from(result) == ""


def test_threads_have_several_simulations_each() -> None:
    result = physics(examples.make(), nthread=5)
    assert isinstance(result, PhysicsAlone)
    assert result.workload.nbatch >= 20


@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        (examples.NewGravity(), r"changes its model \(opt.gravity\)"),
        (examples.WritesBetween(), "writes qvel between steps of the engine"),
        (examples.Varying(), "takes 1 to 3 steps of the engine"),
        (examples.StaleStart(), "does not reach the same state"),
        (examples.Threaded(), "in threads of its own"),
        (examples.NoPhysics(), "never steps the engine"),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)
def test_what_a_plain_loop_cannot_do_is_not_compared(environment: Any, reason: str) -> None:
    result = physics(environment)
    assert isinstance(result, str)
    assert re.search(reason, result)


def test_a_wrong_state_is_found_with_its_step() -> None:
    result = physics(examples.make())
    assert isinstance(result, PhysicsAlone)
    result.final_state[3, 1] = np.nextafter(result.final_state[3, 1], 1.0)
    text = difference_from(result)
    assert text.endswith("after step 20 of the environment")
    assert text.startswith("qpos[0] is ")
