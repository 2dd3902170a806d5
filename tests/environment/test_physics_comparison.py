"""The same physics by other paths."""

from typing import Any

import example_environments as examples
import numpy as np

from mjbench.comparison import selection
from mjbench.comparison.messages import AgreementReport
from mjbench.comparison.plan import Variant
from mjbench.environment import physics_comparison
from mjbench.environment.adapters import adapt
from mjbench.environment.passes import EnvironmentPasses
from mjbench.environment.physics_comparison import CHOICES, PATHS
from mjbench.environment.recording import EngineWatch
from mjbench.environment.workload import PhysicsAlone, alone
from mjbench.status import Status


class Channel:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    def send(self, message: object) -> None:
        self.sent.append(message)

    def doing(self, text: str, item: int | None = None) -> None:
        pass

    def allow_silence(self, seconds: float) -> None:
        pass


def compared(environment: Any, variants: tuple[Variant, ...]) -> Any:
    adapter = adapt(environment)
    watch = EngineWatch()
    passes = EnvironmentPasses(adapter, adapter.draw_actions(40, 0), 0)
    passes.recorded(watch, lambda: None)
    physics = alone(watch.recording(), 0, 2)
    assert isinstance(physics, PhysicsAlone)
    channel = Channel()
    comparison = physics_comparison.prepare(physics, variants, channel)  # type: ignore[arg-type]
    return comparison, [message for message in channel.sent if isinstance(message, AgreementReport)]


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
