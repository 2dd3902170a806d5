"""Functions of the engine that are as fast as a step, and that are none."""

from collections.abc import Callable, Sequence
from sys import _getframe as get_frame
from typing import TYPE_CHECKING, Any

from .call_bursts import BURST_CALLS, Burst, CallBursts
from .function_replacement import engine_function
from .watch import Watch

# Calls between two steps that are timed with them; more would make bursts of steps cost too much.
MOST_BETWEEN_STEPS = 8

if TYPE_CHECKING:
    from .step_clock import StepClock


class EngineCalls:
    """Times functions while steps are timed.

    Where many of their calls follow each other without a step, as in inverse kinematics, they have
    bursts of their own, until few do for as many steps as a burst has.
    """

    def __init__(
        self,
        steps: "StepClock",
        burst: Burst,
        bursts: CallBursts,
        watch: Watch,
        now_ns: Callable[[], int],
    ) -> None:
        self._steps, self._burst, self._bursts = steps, burst, bursts
        self._watch, self._now_ns = watch, now_ns

    def begin_process(self) -> None:
        self._bursts.begin_process()
        self._is_alone = False  # whether they have bursts of their own
        self._calls_since_step = 0
        self._steps_with_few = 0  # in a row
        self._step_count = 0  # changes with each step

    def timing(self, function: Any, name: str) -> Any:
        now_ns, add, steps, bursts = self._now_ns, self._burst.add, self._steps, self._bursts

        def call(_: Any, *args: Any, **kwargs: Any) -> Any:
            step_count = steps.to_pass + steps.burst_calls
            if step_count != self._step_count:
                self._note_step(step_count)
            self._calls_since_step += 1
            if not self._is_alone and self._calls_since_step > MOST_BETWEEN_STEPS:
                self._is_alone = True
                self._steps.break_burst()
                self._step_count = self._steps.to_pass
            if self._is_alone and bursts.to_pass:
                bursts.to_pass -= 1
                return function(*args, **kwargs)
            if not self._is_alone and steps.to_pass:
                return function(*args, **kwargs)
            if self._is_alone and bursts.begins:
                self._begin_burst(args, get_frame(1))
            begin_ns = now_ns()
            result = function(*args, **kwargs)
            frame, end_ns = get_frame(1), now_ns()
            if self._is_alone:
                bursts.add(name, frame, begin_ns, end_ns)
            else:
                add(name, frame, begin_ns, end_ns, 0)
            return result

        return engine_function(call, function)

    def _note_step(self, step_count: int) -> None:
        has_few = self._calls_since_step <= MOST_BETWEEN_STEPS
        self._steps_with_few = self._steps_with_few + 1 if has_few else 0
        if self._is_alone and self._steps_with_few > BURST_CALLS:
            self._is_alone = False
            self._bursts.end()
        self._step_count, self._calls_since_step = step_count, 0

    def _begin_burst(self, args: Sequence[Any], frame: Any) -> None:
        """Begin a burst, and look at the simulation from time to time; the first may be set-up."""
        now_ns, is_loop = self._now_ns(), self._bursts.calls_timed > 0
        if is_loop and now_ns >= self._watch.next_look_ns and len(args) > 1:
            self._watch.look(args[0], args[1], frame, now_ns)
        self._bursts.call_cost_ns = self._steps.cold_ns
        self._bursts.passed_cost_ns = self._steps.passed_ns
        self._bursts.begin()

    def end(self) -> None:
        self._bursts.end()
