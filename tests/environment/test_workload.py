"""The physics of an environment as a workload."""

import re
from typing import Any

import example_environments as examples
import numpy as np
import pytest

from mjbench.environment import physics_comparison
from mjbench.environment.adapters import adapt
from mjbench.environment.passes import EnvironmentPasses
from mjbench.environment.recording import EngineWatch
from mjbench.environment.workload import PhysicsAlone, alone
from mjbench.simulation import work


def physics(environment: Any, nstep: int = 40, nthread: int = 2) -> PhysicsAlone | str:
    adapter = adapt(environment)
    watch = EngineWatch()
    passes = EnvironmentPasses(adapter, adapter.draw_actions(nstep, 0), 0)
    passes.recorded(watch, lambda: None)
    return alone(watch.recording(), 0, nthread)


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
    reached = work.observe(result.workload).final_state
    assert reached.tobytes() == result.final_state.tobytes()
    assert physics_comparison.difference_from(result) == ""


def test_what_is_written_before_a_step_begins_a_run() -> None:
    result = physics(examples.Mocap())
    assert isinstance(result, PhysicsAlone)
    assert (result.run, result.workload.nbatch) == (1, 40)
    assert physics_comparison.difference_from(result) == ""


def test_only_steps_of_one_model_are_compared() -> None:
    result = physics(examples.NewMass())
    assert isinstance(result, PhysicsAlone)
    assert result.numbers.tolist() == list(range(15))
    assert physics_comparison.difference_from(result) == ""


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
    text = physics_comparison.difference_from(result)
    assert text.endswith("after step 20 of the environment")
    assert text.startswith("qpos[0] is ")
