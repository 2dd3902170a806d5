"""The blocks of one launch of a race: paths that run one workload in turns, in this process.

It is the worker's part of `race`: after the worker has read model and workload, it prepares one
path after the other, and then times blocks of them as it is asked. The simulations are reordered
before each round, so that the output of an earlier block is wrong, and what every block returns is
compared, outside the timed region.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.comparison.verification import ReferenceCase
from mjbench.errors import InputError
from mjbench.paired.worker_answers import TimedEntrant
from mjbench.simulation.model_guard import ModelGuard

# A block this long shows nothing of what the first run after the check still sets up.
_LONG_BLOCK_S = 1.0


@dataclass
class RaceBlocks:
    """The paths of one launch, and the work that all of them do."""

    case: ReferenceCase
    rng: np.random.Generator
    _prepared: list[paths.Prepared] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._guard = ModelGuard(self.case.workload.model)

    def prepare(self, path_name: str, options: Mapping[str, Any]) -> None:
        """Prepare a path after the others; check what it returns, and run a short one once more."""
        path, workload = paths.find(path_name), self.case.workload
        if reason := path.cannot_run(workload, options):
            raise InputError(reason)
        prepared = path.prepare(workload, options, self.case.resources)
        begin = time.perf_counter()
        states = prepared.verified_states()
        is_short = time.perf_counter() - begin < _LONG_BLOCK_S
        if difference := self.case.difference(states, prepared):
            raise InputError(f"in a fresh process: {difference}")
        if is_short:  # what is left of the start-up would show in the first block that is timed
            prepared.clear()
            prepared.run()
        self._guard.check()
        self._prepared.append(prepared)

    def time(self, number: int, reorders: bool) -> TimedEntrant:
        """Run one block of a path, and compare what it returns."""
        if reorders:
            self.case.reorder(self.rng)
        prepared, clock = self._prepared[number], time.perf_counter_ns
        prepared.clear()
        run = prepared.run
        begin = clock()
        run()
        ns = clock() - begin
        self._guard.check()
        difference = self.case.difference(prepared.final_states(), prepared)
        return TimedEntrant(ns, f"in a timed block: {difference}" if difference else "")
