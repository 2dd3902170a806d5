"""Functions of the engine that are as fast as a step, and that are none."""

from collections.abc import Callable, Sequence
from sys import _getframe as get_frame
from typing import TYPE_CHECKING, Any

from .call_bursts import CallBursts
from .function_replacement import engine_function
from .watch import Watch

if TYPE_CHECKING:
    from .step_clock import StepClock


class EngineCalls:
    """Times functions in bursts of their own: many may follow each other without a step."""

    def __init__(
        self, steps: "StepClock", bursts: CallBursts, watch: Watch, now_ns: Callable[[], int]
    ) -> None:
        self._steps, self._watch, self._now_ns = steps, watch, now_ns
        self.bursts = bursts

    def timing(self, function: Any, name: str) -> Any:
        now_ns, bursts, pacer = self._now_ns, self.bursts, self.bursts.pacer

        def call(_: Any, *args: Any, **kwargs: Any) -> Any:
            for _ in pacer.passes:
                return function(*args, **kwargs)
            if bursts.begins:
                self._begin_burst(args, get_frame(1))
            begin_ns = now_ns()
            result = function(*args, **kwargs)
            bursts.add(name, get_frame(1), begin_ns, now_ns())
            return result

        return engine_function(call, function)

    def _begin_burst(self, args: Sequence[Any], frame: Any) -> None:
        """Begin a burst, and look at the simulation from time to time; the first may be set-up."""
        now_ns, is_loop = self._now_ns(), self.bursts.calls_timed > 0
        if is_loop and now_ns >= self._watch.next_look_ns and len(args) > 1:
            self._watch.look(args[0], args[1], frame, now_ns)
        self.bursts.call_cost_ns = self._steps.cold_ns
        self.bursts.passed_cost_ns = self._steps.passed_ns
        self.bursts.begin()
