"""How often calls are timed: in bursts, so that timing them costs little of the program's time."""

import time
from collections.abc import Callable

# Calls of a burst, a prime: bursts end at different places of episodes. What timing them may cost
# of the program's time; to pass calls through costs a little more, which cannot be spared. The
# program's processor time is what counts: of two processes that share a core, each is slowed by the
# clock of both.
BURST_CALLS, MAX_COST_SHARE = 199, 0.003
# What it may cost in any case, so that a fast loop is timed for more than a moment.
FREE_COST_NS = 10_000_000
# Calls of the calibration with cold caches, and bytes that are read before each: what a core's own
# caches hold.
COLD_CALLS, COLD_BYTES = 200, 1 << 20


class Pacer:
    """Says how many calls to pass through until the next burst."""

    def __init__(
        self,
        now_ns: Callable[[], int] = time.perf_counter_ns,
        processor_ns: Callable[[], int] = time.process_time_ns,
    ) -> None:
        self._now_ns, self._processor_ns = now_ns, processor_ns
        self.begin()

    def begin(self) -> None:
        self._start_ns, self._processor_start_ns = self._now_ns(), self._processor_ns()

    def _elapsed_ns(self) -> int:
        processor_ns = self._processor_ns() - self._processor_start_ns
        return min(self._now_ns() - self._start_ns, processor_ns)

    def calls_to_pass(self, cost_ns: int, period_ns: int) -> int:
        """Return how many calls have to pass, so that what was timed has cost its share."""
        owed_ns = max(0, cost_ns - FREE_COST_NS)
        return max(0, int((owed_ns / MAX_COST_SHARE - self._elapsed_ns()) / period_ns))

    def has_earned(self, cost_ns: int) -> bool:
        """Return whether a burst may be timed, after those that have cost so much."""
        return cost_ns - FREE_COST_NS < MAX_COST_SHARE * self._elapsed_ns()


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
