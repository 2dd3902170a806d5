"""How long each layer of a step takes: functions that charge the clock to the layer on top.

At every call and return of a timed function the time since the one before is charged to the
function that ran meanwhile. So the times of all layers add up to the step, whatever calls what.
Timing costs time itself, more than a loop of such calls shows, because the engine leaves little of
the timer in the caches. So nothing is subtracted here: `LayerSamples` have the calls, and
`layer_shares` subtracts what each costs beside this environment.
"""

import contextlib
import functools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mjbench.bounds import NonNegativeFloat
from mjbench.commands.env.callees import Callee
from mjbench.commands.env.layers import Layer
from mjbench.simulation import engine_functions
from mjbench.simulation.engine_functions import STEPPING, Binding, EngineFunction

ClockNs = Callable[[], int]
# Calls of a block when the timer's own cost is measured, and blocks; the fastest counts.
_COST_CALLS, _COST_BLOCKS = 2_000, 7


@dataclass(frozen=True)
class TimerCost:
    """What one call of a timed function costs at least, in nanoseconds: in a loop of such calls.

    Attributes:
      inside_ns: charged to the function.
      outside_ns: charged to its caller.
    """

    inside_ns: NonNegativeFloat
    outside_ns: NonNegativeFloat

    @property
    def total_ns(self) -> float:
        return self.inside_ns + self.outside_ns


@dataclass(frozen=True)
class LayerSamples:
    """What a function inside the step, or the lines of the step itself, took in each round.

    Attributes:
      name: of the function, or of the wrapper's or environment's class.
      calls: of it, per step of the environment.
      timed_calls: of these, how many were timed, and so cost inside it.
      inner_calls: timed calls of other functions, which cost it what they cost outside, per step.
      ns: per step, without functions that it calls and that are timed, with the timer's cost.
    """

    layer: Layer
    name: str
    calls: NonNegativeFloat
    timed_calls: NonNegativeFloat
    inner_calls: NonNegativeFloat
    ns: Sequence[NonNegativeFloat]


@dataclass(slots=True)
class _Total:
    calls: int = 0
    timed_calls: int = 0
    inner_calls: int = 0
    ns: int = 0


def in_all_rounds(samples: Sequence[LayerSamples], nround: int) -> list[LayerSamples]:
    """Join the rounds of each function; without those that were not called in each."""
    joined: dict[tuple[Layer, str], LayerSamples] = {}
    for each in samples:
        first = joined.setdefault((each.layer, each.name), replace(each, ns=[]))
        joined[each.layer, each.name] = replace(first, ns=[*first.ns, *each.ns])
    return [each for each in joined.values() if len(each.ns) == nround]


class LayerTimer:
    """Times functions by layer, in the thread that made it."""

    def __init__(self, clock_ns: ClockNs = time.perf_counter_ns):
        self._clock_ns = clock_ns
        self._thread = threading.get_ident()
        self._totals: dict[tuple[Layer, str], _Total] = {}
        self._stack: list[_Total] = []
        self._last = [0]

    def outermost(
        self, function: Callable[[Any], Any], layer: Layer, name: str
    ) -> Callable[[Any], tuple[Any, int]]:
        """Return a function that runs a whole step, and returns its result and its nanoseconds."""
        own, stack, last = self._totals.setdefault((layer, name), _Total()), self._stack, self._last
        clock_ns = self._clock_ns

        def run(action: Any) -> tuple[Any, int]:
            stack.append(own)
            own.calls += 1
            begin = last[0] = clock_ns()
            try:
                outcome = function(action)
                end = clock_ns()
                own.ns += end - last[0]
                return outcome, end - begin
            finally:
                stack.clear()

        return run

    def timed(self, function: EngineFunction, layer: Layer, name: str) -> EngineFunction:
        """Return a function that does the same, and charges its time to a layer.

        Outside of a step, and in another thread, it does nothing else.
        """
        own, stack, last = self._totals.setdefault((layer, name), _Total()), self._stack, self._last
        clock_ns, thread, get_ident = self._clock_ns, self._thread, threading.get_ident

        def run(*args: Any, **keywords: Any) -> Any:
            if not stack or get_ident() != thread:
                return function(*args, **keywords)
            now = clock_ns()
            caller = stack[-1]
            caller.ns += now - last[0]
            caller.inner_calls += 1
            own.calls += 1
            own.timed_calls += 1
            stack.append(own)
            last[0] = now
            try:
                return function(*args, **keywords)
            finally:
                now = clock_ns()
                own.ns += now - last[0]
                if stack:
                    stack.pop()
                last[0] = now

        with contextlib.suppress(Exception):  # some callables have no name
            functools.update_wrapper(run, function)
        return run

    def layers(self, nstep: int = 1) -> list[LayerSamples]:
        """Return what each function that was called took in `nstep` steps, as one round."""
        return [
            LayerSamples(
                *key,
                each.calls / nstep,
                each.timed_calls / nstep,
                each.inner_calls / nstep,
                [each.ns / nstep],
            )
            for key, each in self._totals.items()
            if each.calls
        ]


def measure_cost(clock_ns: ClockNs = time.perf_counter_ns) -> TimerCost:
    """Return what a call of a timed function costs in a loop; of several loops, the fastest."""
    blocks = [_block_ns(clock_ns) for _ in range(_COST_BLOCKS)]
    plain_ns, inside_ns, all_ns = (min(times) for times in zip(*blocks, strict=True))
    inside = max(0.0, (inside_ns - plain_ns) / _COST_CALLS)
    return TimerCost(inside, max(0.0, (all_ns - plain_ns) / _COST_CALLS - inside))


def _block_ns(clock_ns: ClockNs) -> tuple[int, int, int]:
    timer = LayerTimer(clock_ns)
    timed = timer.timed(_nothing, Layer.REST, "inside")

    def call_many(function: Callable[[], None]) -> int:
        begin = clock_ns()
        for _ in range(_COST_CALLS):
            function()
        return clock_ns() - begin

    plain_ns = call_many(_nothing)
    _, all_ns = timer.outermost(lambda _: call_many(timed), Layer.REST, "outside")(None)
    return plain_ns, timer._totals[Layer.REST, "inside"].ns, all_ns


def _nothing() -> None:
    pass


@contextlib.contextmanager
def engine_timed(timer: LayerTimer, elsewhere: Sequence[Binding]) -> Iterator[None]:
    def wrapper(name: str) -> Callable[[EngineFunction], EngineFunction]:
        layer = Layer.PHYSICS if name in STEPPING else Layer.ENGINE
        return lambda function: timer.timed(function, layer, name)

    wrappers = {name: wrapper(name) for name in engine_functions.names()}
    with engine_functions.replaced(wrappers, elsewhere):
        yield


@contextlib.contextmanager
def functions_timed(timer: LayerTimer, callees: Sequence[Callee]) -> Iterator[None]:
    """Time functions of an environment while the block runs, but not what cannot be replaced."""
    with contextlib.ExitStack() as restoring:
        for callee in callees:
            owner, attribute = callee.owner, callee.attribute
            try:
                had_own = attribute in vars(owner)
                function = getattr(owner, attribute)
                setattr(owner, attribute, timer.timed(function, callee.layer, callee.name))
            except Exception:  # an object of the user's may refuse it by any error
                continue
            if had_own:
                restoring.callback(setattr, owner, attribute, function)
            else:
                restoring.callback(delattr, owner, attribute)
        yield
