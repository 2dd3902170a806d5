"""The blocks of one launch of a race: paths that run one workload in turns, in this process.

It is the worker's part of `race`: after the worker has read model and workload, it prepares one
path after the other, and then times rounds of all of them. The simulations are reordered before
each round, so that the output of an earlier block is wrong, and what every block returns is
compared, outside the timed region.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mjbench import paths
from mjbench.comparison.verification import ReferenceCase
from mjbench.errors import InputError
from mjbench.paired.requests import PrepareEntrant, TimedRounds


@dataclass
class RaceBlocks:
    """The paths of one launch, and the work that all of them do.

    Attributes:
      case: the workload, and what it must come to.
      rng: draws the orders of simulations.
    """

    case: ReferenceCase
    rng: np.random.Generator
    _prepared: list[paths.Prepared] = field(default_factory=list)

    def prepare(self, request: PrepareEntrant) -> None:
        """Prepare a path after the others, and run it twice, the first time to check it.

        Raises:
          InputError: it cannot run, or returns something else than the plain loop.
        """
        path, workload = paths.find(request.path), self.case.workload
        reason = path.unavailable() or path.cannot_return(workload.returns)
        reason = reason or path.unsuited(workload, request.options)
        if reason:
            raise InputError(reason)
        prepared = path.prepare(workload, request.options, self.case.resources)
        if difference := self.case.difference(prepared.verified_states(), prepared):
            raise InputError(f"in a fresh process: {difference}")
        prepared.clear()
        prepared.run()
        self._prepared.append(prepared)

    def time(self, orders: Sequence[Sequence[int]]) -> TimedRounds:
        """Time rounds; in each, every path runs one block.

        Args:
          orders: of the paths in each round, by the order in which they were prepared.
        """
        clock, ns, differences = time.perf_counter_ns, list[list[int]](), dict[int, str]()
        for order in orders:
            self.case.reorder(self.rng)
            row = [0] * len(self._prepared)
            for k in order:
                prepared = self._prepared[k]
                prepared.clear()
                run = prepared.run
                begin = clock()
                run()
                row[k] = clock() - begin
                if difference := self.case.difference(prepared.final_states(), prepared):
                    differences.setdefault(k, f"in a timed block: {difference}")
            ns.append(row)
        return TimedRounds(ns, differences)
