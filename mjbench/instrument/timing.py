"""Blocks of work timed in turns, so that the machine's drift hits every contender alike.

A round times every contender once, in an order drawn anew for each round (the block that follows
a given neighbour pays for what that neighbour left in the caches). Times are raw: nothing is
averaged, corrected or thrown away here.
"""

import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

Clock = Callable[[], float]


@dataclass(frozen=True)
class Contender:
    """Something to time.

    Attributes:
      before: called before each block, untimed.
      run: the block.
      after: called after each block, untimed.
    """

    before: Callable[[], None]
    run: Callable[[], None]
    after: Callable[[], None]


def block_s(contender: Contender, clock: Clock = time.perf_counter) -> float:
    """Time one block of a contender; return seconds."""
    contender.before()
    start = clock()
    contender.run()
    elapsed = clock() - start
    contender.after()
    return elapsed


def rounds(
    contenders: Sequence[Contender],
    budget_s: float,
    least: int,
    most: int,
    seed: int = 0,
    clock: Clock = time.perf_counter,
) -> Iterator[list[float]]:
    """Time the contenders in turns; yield the seconds of each round, in the contenders' order.

    Args:
      contenders: what to time.
      budget_s: no round begins that would end later than this, going by the longest so far.
      least: rounds that are made whatever they take.
      most: rounds after which to stop in any case.
      seed: decides the order within each round.
      clock: returns seconds.
    """
    order, shuffle = list(range(len(contenders))), random.Random(seed).shuffle
    begin, longest = clock(), 0.0
    for done in range(most):
        now = clock()
        if done >= least and now - begin + longest > budget_s:
            return
        shuffle(order)
        seconds = [0.0] * len(contenders)
        for i in order:
            seconds[i] = block_s(contenders[i], clock)
        longest = max(longest, clock() - now)
        yield seconds
