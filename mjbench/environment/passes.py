"""Passes over the recorded actions: each resets to the same starts and takes the same steps.

A plain pass times only steps and resets. A layered pass also times the functions inside a step.
"""

import contextlib
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from mjbench.environment import callees
from mjbench.environment.adapters import EnvironmentAdapter
from mjbench.environment.construction import as_input_error
from mjbench.environment.engine import Binding
from mjbench.environment.recording import EngineWatch
from mjbench.environment.repetition import Fingerprint
from mjbench.environment.timer import (
    ClockNs,
    LayerTime,
    LayerTimer,
    engine_timed,
    functions_timed,
)
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.measuring.timing import Contender

_T = TypeVar("_T")
# The fewest and most rounds; a 95 % interval needs six.
LEAST_ROUNDS, MOST_ROUNDS = 7, 100
# A child may be silent for this many times as long as its work should take.
PATIENCE = 20


def send_rounds(time_round: Callable[[], object], budget_s: float, channel: Channel) -> None:
    """Time rounds until the budget is used; send what each returns.

    One that is not sent comes first, as it touches all memory.
    """
    results: list[object] = []
    contender = Contender(lambda: results.append(time_round()))
    longest_s = timing.block_s(contender)
    channel.allow_silence(PATIENCE * longest_s)
    rounds = timing.rounds([contender], budget_s, LEAST_ROUNDS, MOST_ROUNDS, longest_s=longest_s)
    for (seconds,) in rounds:
        channel.send(results.pop())
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
    """A pass over the recorded actions.

    Attributes:
      step_ns: (nstep,) of each step of the environment.
      lengths: steps of each episode that ended.
      returned: fingerprint of what the steps returned; of nothing where passes took turns.
      layers: what each function that was called took, with the timer's cost, where it was timed.
    """

    step_ns: np.ndarray
    reset_ns: Sequence[int]
    lengths: Sequence[int]
    returned: Fingerprint
    layers: Sequence[LayerTime] = ()


# Prepares an episode after its reset, and yields a function that returns the outcome of a step and
# its nanoseconds.
_TimedStep = Callable[[Any], tuple[Any, int]]
_BeginEpisode = Callable[[], contextlib.AbstractContextManager[_TimedStep]]


class EnvironmentPasses:
    """Replays actions in an environment; what this raises becomes an InputError."""

    def __init__(
        self,
        adapter: EnvironmentAdapter,
        actions: Sequence[Any],
        seed: int,
        clock_ns: ClockNs = time.perf_counter_ns,
    ):
        """Replay `actions`; episode number i is reset with `seed` + i."""
        self.adapter, self.actions, self.seed, self.clock_ns = adapter, actions, seed, clock_ns

    def plain(self, heartbeat: Callable[[], None] = lambda: None) -> Pass:
        """Return the times of a pass.

        Args:
          heartbeat: called after every step, untimed.
        """
        return _Replay(self, self._begin_plain, heartbeat, Fingerprint()).run()

    def recorded(self, watch: EngineWatch, heartbeat: Callable[[], None]) -> Pass:
        """Return a pass that `watch` watches; its times include the watching."""

        def begin_episode() -> contextlib.AbstractContextManager[_TimedStep]:
            step = self._step()
            watch.begin_episode()
            return self._timed(lambda action: watch.run(lambda: step(action)))

        with watch.watching():
            return _Replay(self, begin_episode, heartbeat, Fingerprint()).run()

    def side_by_side(self, elsewhere: Sequence[Binding], rng: random.Random) -> tuple[Pass, Pass]:
        """Return a plain pass and a layered one, which take turns from episode to episode.

        Args:
          rng: draws which of the two is first in each episode.
        """
        timer = LayerTimer(self.clock_ns)
        plain = _Replay(self, self._begin_plain)
        layered = _Replay(self, lambda: self._begin_layered(timer, elsewhere))
        both = [plain, layered]
        more_follow = True
        while more_follow:
            rng.shuffle(both)
            remaining = [replay.run_episode() for replay in both]
            more_follow = any(remaining)
        called = [layer for layer in timer.layers() if layer.calls]
        return plain.result(), replace(layered.result(), layers=called)

    def _begin_plain(self) -> contextlib.AbstractContextManager[_TimedStep]:
        """Prepare an episode whose steps are timed as a whole."""
        return self._timed(self._step())

    def _timed(self, step: Callable[[Any], Any]) -> contextlib.AbstractContextManager[_TimedStep]:
        clock_ns = self.clock_ns

        def run(action: Any) -> tuple[Any, int]:
            begin = clock_ns()
            outcome = step(action)
            return outcome, clock_ns() - begin

        return contextlib.nullcontext(run)

    @contextlib.contextmanager
    def _begin_layered(
        self, timer: LayerTimer, elsewhere: Sequence[Binding]
    ) -> Iterator[_TimedStep]:
        """Prepare an episode whose steps are timed by layer."""
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


class _Replay:
    """A pass, episode by episode."""

    def __init__(
        self,
        passes: EnvironmentPasses,
        begin_episode: _BeginEpisode,
        heartbeat: Callable[[], None] = lambda: None,
        returned: Fingerprint | None = None,
    ):
        self._passes, self._actions = passes, passes.actions
        self._begin_episode, self._heartbeat = begin_episode, heartbeat
        self._returned = returned
        self._step_ns = np.zeros(len(self._actions), dtype=np.int64)
        self._reset_ns: list[int] = []
        self._lengths: list[int] = []
        self._number = 0

    def run(self) -> Pass:
        """Run all episodes."""
        while self.run_episode():
            pass
        return self.result()

    def run_episode(self) -> bool:
        """Reset, take the steps of the next episode, and return whether more follow."""
        if self._number == len(self._actions):
            return False
        first = self._number
        self._reset_ns.append(self._reset())
        with self._begin_episode() as step:
            is_over = False
            while not is_over and self._number < len(self._actions):
                with as_input_error("its step"):
                    outcome, self._step_ns[self._number] = step(self._actions[self._number])
                    is_over = self._passes.adapter.is_over(outcome)
                    self._note(outcome)
                self._number += 1
                self._heartbeat()
        if is_over:
            self._lengths.append(self._number - first)
        return self._number < len(self._actions)

    def _note(self, outcome: Any) -> None:
        """Add what a step returned to the fingerprint, if there is one."""
        if self._returned is not None:
            for field, value in self._passes.adapter.fields(outcome).items():
                self._returned.add(field, value)

    def _reset(self) -> int:
        """Reset the environment, and return how many nanoseconds it took."""
        with as_input_error("its reset"):
            passes = self._passes
            reset = passes.adapter.resetting(passes.seed + len(self._reset_ns))
            begin = passes.clock_ns()
            reset()
            return passes.clock_ns() - begin

    def result(self) -> Pass:
        """Return the pass, now that it is over."""
        returned = self._returned or Fingerprint()
        return Pass(self._step_ns, self._reset_ns, self._lengths, returned)
