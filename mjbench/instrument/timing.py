"""Time blocks of work in turns, so that the machine's drift affects every contender alike.

A round times every contender once. Each round has its own random order, because a block's time
depends on what the block before it left in the caches. Times are raw: nothing is averaged,
corrected or discarded here.
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
      before: called before each block; not timed.
      run: the block.
      after: called after each block; not timed.
    """

    before: Callable[[], None]
    run: Callable[[], None]
    after: Callable[[], None]


def block_s(contender: Contender, clock: Clock = time.perf_counter) -> float:
    """Time one block of a contender and return the seconds it took."""
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
      contenders: to time.
      budget_s: seconds for all rounds; no round begins that would exceed them if it took as long as
        the longest so far.
      least: number of rounds to time even if they exceed the budget.
      most: number of rounds after which to stop.
      seed: of the order within each round.
      clock: returns seconds.
    """
    order, shuffle = list(range(len(contenders))), random.Random(seed).shuffle
    begin, longest_s = clock(), 0.0
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
