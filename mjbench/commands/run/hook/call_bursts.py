"""Calls that are timed in bursts, so that timing them costs little of the program's time.

A `Pacer` lets calls pass between bursts, and counts them; a `Burst` has the slots of those that are
timed. `StepClock` has one of each for the steps, `CallBursts` one of each for other fast calls.
"""

import time
from _thread import get_ident
from collections.abc import Callable, Sequence
from itertools import repeat
from operator import length_hint
from types import FrameType
from typing import Any

from .call_clock import CallClock

# Calls of a burst, a prime: bursts end at different places of episodes. What timing them may cost
# of the program's time; to pass calls through costs a little more, which cannot be spared. The
# program's processor time is what counts: of two processes that share a core, each is slowed by the
# clock of both.
BURST_CALLS, MAX_COST_SHARE = 199, 0.003
# What it may cost in any case, so that a fast loop is timed for more than a moment, and the time
# over which this is spread: calls between two bursts count as those in the second.
FREE_COST_NS, FREE_SPREAD_NS = 10_000_000, 1_000_000_000
# Calls of the calibration with cold caches, and bytes that are read before each: what a core's own
# caches hold.
COLD_CALLS, COLD_BYTES = 200, 1 << 20
# A burst also ends after this time: calls that are this slow need not be passed through.
_LONGEST_NS = 100_000_000
# Slots with the calls of a burst, their ns, and the steps in them.
Written = Sequence[tuple[list[int], int, int, int]]


class Pacer:
    """Lets calls pass through until the next burst.

    Attributes:
      passes: has an item for each call that may still pass. A call takes one by `for _ in passes`,
        which counts it in C: a step of the smallest models takes little longer than Python takes
        to count.
      passed_before: calls that had passed before the latest plan.
    """

    def __init__(
        self,
        now_ns: Callable[[], int] = time.perf_counter_ns,
        processor_ns: Callable[[], int] = time.process_time_ns,
    ) -> None:
        self._now_ns, self._processor_ns = now_ns, processor_ns
        self.begin()

    def begin(self) -> None:
        self._start_ns, self._processor_start_ns = self._now_ns(), self._processor_ns()
        self._spent_ns = self._planned = self.passed_before = 0
        self.passes = repeat(None, 0)

    @property
    def passed_since(self) -> int:
        """Calls that have passed since the latest plan."""
        return self._planned - length_hint(self.passes)

    @property
    def passed(self) -> int:
        return self.passed_before + self.passed_since

    def let_pass(self, calls: int) -> None:
        """Plan anew: let this many calls pass, and no more of those planned before."""
        self.passed_before = self.passed
        self._planned, self.passes = calls, repeat(None, calls)

    def spend(self, cost_ns: int) -> None:
        """Note what timing has cost, by what is known now: what is learned later does not count."""
        self._spent_ns += cost_ns

    def calls_to_pass(self, period_ns: int) -> int:
        """Return how many calls have to pass, so that what was timed has cost its share."""
        at_first = MAX_COST_SHARE + FREE_COST_NS / FREE_SPREAD_NS
        earned_ns = max(self._spent_ns / at_first, (self._spent_ns - FREE_COST_NS) / MAX_COST_SHARE)
        processor_ns = self._processor_ns() - self._processor_start_ns
        elapsed_ns = min(self._now_ns() - self._start_ns, processor_ns)
        return max(0, int((earned_ns - elapsed_ns) / period_ns))


def cold_cost_ns(
    call: Callable[[], object], nothing: Callable[[], object], now_ns: Callable[[], int]
) -> int:
    """Return what a timed call costs where the caches hold the program's data, not the clock's.

    A step of the engine leaves little of the clock in them.
    """
    data = bytes(COLD_BYTES)
    medians = []
    for function in (call, nothing):
        durations = []
        for _ in range(COLD_CALLS):
            data.count(1)  # reads them all
            begin_ns = now_ns()
            function()
            durations.append(now_ns() - begin_ns)
        medians.append(sorted(durations)[COLD_CALLS // 2])
    return medians[0] - medians[1]


class Burst:
    """The slots of calls that are timed in bursts, such as steps."""

    def __init__(self, calls: CallClock) -> None:
        self._calls = calls
        self.begin_process()

    def begin_process(self) -> None:
        # slots, with what they had counted before
        self._unwritten: dict[int, tuple[list[int], int, int, int]] = {}
        self._cached: tuple[str, Any, int, int] | None = None
        self._cached_slot: list[int] = []

    def add(self, callee: str, frame: FrameType, begin_ns: int, end_ns: int, steps: int) -> None:
        """Count a call; `write` writes its slot."""
        # most calls are made where the one before was made
        place = (callee, frame.f_code, frame.f_lasti, get_ident())
        cached = self._cached
        if (
            cached is not None
            and cached[1] is place[1]
            and cached[2] == place[2]
            and cached[0] is callee
            and cached[3] == place[3]
        ):
            slot = self._cached_slot
        else:
            new_slot = self._calls.slot(callee, frame, begin_ns)
            if new_slot is None:
                return
            slot = new_slot
            if self._calls.is_own.get(frame.f_code.co_filename):
                self._cached, self._cached_slot = place, slot
        if slot[0] not in self._unwritten:
            self._unwritten[slot[0]] = slot, slot[3], slot[4], slot[7]
        duration_ns = end_ns - begin_ns
        slot[1] += 1
        slot[2] += duration_ns
        slot[3] += 1
        slot[4] += duration_ns
        slot[6] = end_ns
        slot[7] += steps
        slot[8] += steps

    def write(self) -> Written:
        """Write the slots of calls since they were last written; return them."""
        unwritten, self._unwritten = self._unwritten, {}
        for slot, *_ in unwritten.values():
            self._calls.write(slot)
        return [
            (slot, slot[3] - calls, slot[4] - ns, slot[7] - steps)
            for slot, calls, ns, steps in unwritten.values()
        ]

    def pass_on(self, written: Written, bursts: float, until_ns: int = 0) -> None:
        """Count untimed calls: as many bursts as were written, until `until_ns`, if known."""
        for slot, calls, ns, steps in written:
            slot[9] += round(calls * bursts)
            slot[10] += round(ns * bursts)
            slot[11] += round(steps * bursts)
            slot[6] = max(slot[6], until_ns)
            self._calls.write(slot)


class CallBursts:
    """Bursts of calls that are paced by themselves, such as those of JAX."""

    def __init__(
        self,
        calls: CallClock,
        now_ns: Callable[[], int] = time.perf_counter_ns,
        processor_ns: Callable[[], int] = time.process_time_ns,
    ) -> None:
        self._calls, self._burst, self._now_ns = calls, Burst(calls), now_ns
        self.pacer = Pacer(now_ns, processor_ns)
        self.call_cost_ns = self.passed_cost_ns = 0
        self.begin_process()

    def begin_process(self) -> None:
        self._burst.begin_process()
        self.pacer.begin()
        self.calls_timed = self._burst_calls = 0
        self._latest: Written = ()
        self._begin_ns = self._end_ns = self._period_ns = self._cost_ns = 0

    @property
    def begins(self) -> bool:
        return not self._burst_calls

    def count(self) -> int:
        return self.calls_timed + self._burst_calls + self.pacer.passed

    def begin(self) -> None:
        if not self._burst_calls:
            self._begin_ns = self._now_ns()

    def add(self, callee: str, frame: FrameType, begin_ns: int, end_ns: int) -> None:
        self._burst.add(callee, frame, begin_ns, end_ns, 0)
        self._burst_calls += 1
        if self._burst_calls >= BURST_CALLS or end_ns - self._begin_ns > _LONGEST_NS:
            self._finish(end_ns)

    def _finish(self, end_ns: int) -> None:
        """End a burst: decide how many calls to pass through until the next one."""
        calls, self._burst_calls = self._burst_calls, 0
        if not calls:  # another thread has ended it
            return
        self._latest = self._burst.write()
        self._pass_on()
        self.calls_timed += calls
        self._period_ns = max(1, (end_ns - self._begin_ns) // calls)
        self._note_cost()
        self.pacer.spend(calls * self.call_cost_ns)
        self.pacer.let_pass(self.pacer.calls_to_pass(self._period_ns))
        self._end_ns = end_ns

    def _pass_on(self, until_ns: int = 0) -> None:
        """Let the calls that have passed before the latest burst count as those in it."""
        passed = self.pacer.passed_since
        if passed > 0:
            in_burst = sum(calls for _, calls, _, _ in self._latest)
            self._burst.pass_on(self._latest, passed / max(1, in_burst), until_ns)

    def _note_cost(self) -> None:
        earlier_ns = self._cost_ns
        self._cost_ns = self.calls_timed * self.call_cost_ns
        self._cost_ns += self.pacer.passed * self.passed_cost_ns
        self._calls.cost_ns += self._cost_ns - earlier_ns

    def end(self) -> None:
        """Count what has passed, as far as it could, and break a burst that has begun."""
        passed_ns = self.pacer.passed_since * self._period_ns
        self._pass_on(min(self._end_ns + passed_ns, self._now_ns()))
        self.pacer.let_pass(0)
        self.calls_timed += self._burst_calls
        self._burst_calls = 0
        self._burst.write()
        self._note_cost()
