"""Passes over the recorded actions: each resets to the same starts and takes the same steps.

A plain pass times only steps and resets. A layered pass also times the functions inside a step.
"""

import contextlib
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from mjbench.commands.env import callees
from mjbench.commands.env.adapters import EnvironmentAdapter
from mjbench.commands.env.construction import as_input_error
from mjbench.commands.env.recording import EngineWatch
from mjbench.commands.env.repetition import Fingerprint
from mjbench.commands.env.timer import (
    ClockNs,
    LayerSamples,
    LayerTimer,
    engine_timed,
    functions_timed,
)
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.measuring.timing import Contender
from mjbench.simulation.engine_functions import Binding

_T = TypeVar("_T")
# The fewest and most rounds; a 95 % interval needs six.
LEAST_ROUNDS, MOST_ROUNDS = 7, 100
# A child may be silent for this many times as long as its work should take.
PATIENCE = 20


def time_rounds(
    time_round: Callable[[], _T], add: Callable[[_T], None], budget_s: float, channel: Channel
) -> None:
    """Time rounds until the budget is used, and add each but the first, which touches memory."""
    results: list[_T] = []
    contender = Contender(lambda: results.append(time_round()))
    longest_s = timing.block_s(contender)
    channel.allow_silence(PATIENCE * longest_s)
    rounds = timing.rounds([contender], budget_s, LEAST_ROUNDS, MOST_ROUNDS, longest_s=longest_s)
    for (seconds,) in rounds:
        add(results.pop())
        longest_s = max(longest_s, seconds)
        channel.allow_silence(PATIENCE * longest_s)


def in_random_order(turns: Sequence[Callable[[], _T]], rng: random.Random) -> list[_T]:
    """Call each function once, in random order; return their results in the order given."""
    order = list(range(len(turns)))
    rng.shuffle(order)
    results = {index: turns[index]() for index in order}
    return [results[index] for index in range(len(turns))]


@dataclass(frozen=True, eq=False)
class Pass:
    """A pass over the recorded actions, filled episode by episode.

    Attributes:
      step_ns: (nstep,) of each step of the environment.
      returned: fingerprint of what the steps returned; of nothing where passes took turns.
      layers: as one round; none where functions were not timed.
    """

    step_ns: np.ndarray
    reset_ns: list[int] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)
    returned: Fingerprint = field(default_factory=Fingerprint)
    layers: Sequence[LayerSamples] = ()


# Prepares an episode after its reset, and yields a function that returns the outcome of a step and
# its nanoseconds.
_TimedStep = Callable[[Any], tuple[Any, int]]
_BeginEpisode = Callable[[], contextlib.AbstractContextManager[_TimedStep]]


@dataclass(frozen=True, eq=False)
class EnvironmentPasses:
    """Replays actions; episode i is reset with `seed` + i. What this raises is an InputError."""

    adapter: EnvironmentAdapter
    actions: Sequence[Any]
    seed: int
    clock_ns: ClockNs = time.perf_counter_ns

    def plain(self, heartbeat: Callable[[], None] = lambda: None) -> Pass:
        return self._compared(self._begin_plain, heartbeat)

    def recorded(self, watch: EngineWatch, heartbeat: Callable[[], None]) -> Pass:
        def begin_episode() -> contextlib.AbstractContextManager[_TimedStep]:
            step = self._step()
            watch.begin_episode()
            return self._timed(lambda action: watch.run(lambda: step(action)))

        with watch.watching():
            return self._compared(begin_episode, heartbeat)

    def side_by_side(self, elsewhere: Sequence[Binding], rng: random.Random) -> tuple[Pass, Pass]:
        """Return a plain pass and a layered one, which take turns from episode to episode."""
        timer = LayerTimer(self.clock_ns)
        plain, layered = self._empty_pass(), self._empty_pass()
        replays = [
            self._episodes(plain, self._begin_plain),
            self._episodes(layered, lambda: self._begin_layered(timer, elsewhere)),
        ]
        while replays:
            rng.shuffle(replays)
            replays = [replay for replay in replays if next(replay, False)]
        return plain, replace(layered, layers=timer.layers(len(self.actions)))

    def _begin_plain(self) -> contextlib.AbstractContextManager[_TimedStep]:
        return self._timed(self._step())

    def _timed(self, step: Callable[[Any], Any]) -> contextlib.AbstractContextManager[_TimedStep]:
        clock_ns = self.clock_ns

        def run(action: Any) -> tuple[Any, int]:
            begin = clock_ns()
            outcome = step(action)
            return outcome, max(1, clock_ns() - begin)  # speeds divide by it

        return contextlib.nullcontext(run)

    @contextlib.contextmanager
    def _begin_layered(
        self, timer: LayerTimer, elsewhere: Sequence[Binding]
    ) -> Iterator[_TimedStep]:
        adapter = self.adapter
        layer, name = adapter.outermost_layer()
        # a reset may have replaced what the environment holds
        timed = [*adapter.inner_steps(), *callees.find(adapter.core)]
        step = self._step()
        with engine_timed(timer, elsewhere), functions_timed(timer, timed):
            yield timer.outermost(step, layer, name)

    def _step(self) -> Callable[[Any], Any]:
        step: Callable[[Any], Any] = self.adapter.environment.step
        return step

    def _empty_pass(self) -> Pass:
        return Pass(np.zeros(len(self.actions), dtype=np.int64))

    def _compared(self, begin_episode: _BeginEpisode, heartbeat: Callable[[], None]) -> Pass:
        result = self._empty_pass()

        def add(outcome: Any) -> None:
            for name, value in self.adapter.fields(outcome).items():
                result.returned.add(name, value)

        for _ in self._episodes(result, begin_episode, add, heartbeat):
            pass
        return result

    def _episodes(
        self,
        result: Pass,
        begin_episode: _BeginEpisode,
        inspect: Callable[[Any], None] = lambda outcome: None,
        heartbeat: Callable[[], None] = lambda: None,
    ) -> Iterator[bool]:
        """Replay one episode after the other; yield after each whether more follow."""
        number = 0
        while number < len(self.actions):
            first = number
            result.reset_ns.append(self._reset(len(result.reset_ns)))
            with begin_episode() as step:
                is_over = False
                while not is_over and number < len(self.actions):
                    with as_input_error("its step"):
                        outcome, result.step_ns[number] = step(self.actions[number])
                        is_over = self.adapter.is_over(outcome)
                        inspect(outcome)
                    number += 1
                    heartbeat()
            if is_over:
                result.lengths.append(number - first)
            yield number < len(self.actions)

    def _reset(self, episode: int) -> int:
        with as_input_error("its reset"):
            reset = self.adapter.resetting(self.seed + episode)
            begin = self.clock_ns()
            reset()
            return max(1, self.clock_ns() - begin)
