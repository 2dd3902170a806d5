"""Time blocks of work in turns, so that the machine's drift affects every contender alike.

A round times every contender once. Each round has its own random order, because a block's time
depends on what the block before it left in the caches. Times are raw: nothing is averaged,
corrected or discarded here.
"""

import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mjbench.measuring.calls import nothing

Clock = Callable[[], float]
# A block takes at least this long, even by a clock that does not see it: ratios divide by it.
LEAST_S = 1e-9

# Called with what is measured now, and the share of all work that is done.
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Contender:
    """Something to time; `before` and `after` are called around each block, untimed."""

    run: Callable[[], None]
    before: Callable[[], object] = nothing
    after: Callable[[], None] = nothing


def block_s(contender: Contender, clock: Clock = time.perf_counter) -> float:
    contender.before()
    start = clock()
    contender.run()
    elapsed = clock() - start
    contender.after()
    return max(LEAST_S, elapsed)


def rounds(
    contenders: Sequence[Contender],
    budget_s: float,
    least: int,
    most: int,
    seed: int = 0,
    clock: Clock = time.perf_counter,
    longest_s: float = 0.0,
) -> Iterator[list[float]]:
    """Time the contenders in turns; yield the seconds of each round, in the contenders' order.

    Args:
      budget_s: for all rounds but the `least`; no round begins that would exceed it if it took as
        long as the longest so far.
      longest_s: what the longest round took that was timed before.
    """
    order, shuffle = list(range(len(contenders))), random.Random(seed).shuffle
    begin = clock()
    for completed in range(most):
        round_begin = clock()
        if completed >= least and round_begin - begin + longest_s > budget_s:
            return
        shuffle(order)
        seconds = [0.0] * len(contenders)
        for i in order:
            seconds[i] = block_s(contenders[i], clock)
        longest_s = max(longest_s, clock() - round_begin)
        yield seconds


# Not seeded: an order that is the same in every process could favour one side in all of them.
_RANDOM = random.Random()


def draw_orders(count: int, rng: random.Random = _RANDOM) -> list[str]:
    """Return the orders of `count` quads, each `ABBA` or `BAAB` with equal probability."""
    return [rng.choice(("ABBA", "BAAB")) for _ in range(count)]


def block_times(
    baseline: Callable[[], None],
    candidate: Callable[[], None],
    orders: Sequence[str],
    clock: Clock = time.perf_counter,
    before: Callable[[], object] = nothing,
) -> list[list[float]]:
    """Time two blocks against each other; return the seconds of each, in orders such as `ABBA`."""
    contenders = {"A": Contender(baseline, before), "B": Contender(candidate, before)}
    return [[block_s(contenders[letter], clock) for letter in order] for order in orders]
