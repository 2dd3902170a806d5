"""The blocks of one launch of a race: paths that run one workload in turns, in a worker's process.

The tasks that `race` asks of the worker: it reads model and workload, prepares one path after the
other, and then times a block of a path each time it is asked. The simulations are reordered before
each round, so that the output of an earlier block is wrong, and what every block returns is
compared, outside the timed region.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.errors import InputError
from mjbench.paired import memory_layout
from mjbench.paired.worker import Worker, activity, collect_garbage
from mjbench.simulation import models
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.workload import Product
from mjbench.verification.reference_case import ReferenceCase

# A block this long shows nothing of what the first run after the check still sets up.
_LONG_BLOCK_S = 1.0


@dataclass(frozen=True)
class TimedBlock:
    """A block of a path, and where what it returned first differs from the plain loop."""

    ns: int
    difference: str


@dataclass
class RaceBlocks:
    """The paths of one launch, and the work that all of them do."""

    case: ReferenceCase
    rng: np.random.Generator
    prepared: list[paths.Prepared] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.guard = ModelGuard(self.case.workload.model)


@activity("reading the workload")
def equip(
    worker: Worker,
    model_file: Path,
    workload_file: Path,
    returns: Product,
    cores: Sequence[int],
    import_from: str | None,
) -> None:
    """Read a saved model, and a workload with its final states, for the paths of a race."""
    if import_from:
        sys.path.append(import_from)
    worker.lay_out_memory(cores)
    worker.model = models.load(models.ModelSource("", model_file))
    worker.read_workload(workload_file)
    assert worker.final_state is not None, "a race is run with final states to compare"
    rng = np.random.default_rng(worker.rng.randrange(2**32))
    workload = worker.workload.returning(returns)
    worker.extend(RaceBlocks(ReferenceCase.of_states(workload, worker.final_state), rng))


@activity("preparing a run")
def prepare_path(worker: Worker, path_name: str, options: Mapping[str, Any]) -> None:
    """Prepare a path after the others; check what it returns, and run a short one once more."""
    race = worker.extension(RaceBlocks)
    worker.scattered.append(memory_layout.scattered(worker.rng))
    path, workload = paths.find(path_name), race.case.workload
    if reason := path.cannot_run(workload, options):
        raise InputError(reason)
    prepared = path.prepare(workload, options, race.case.resources)
    begin = time.perf_counter()
    states = prepared.verified_states()
    is_short = time.perf_counter() - begin < _LONG_BLOCK_S
    if difference := race.case.difference(states, prepared):
        raise InputError(f"in a fresh process: {difference}")
    if is_short:  # what is left of the start-up would show in the first block that is timed
        prepared.clear()
        prepared.run()
    race.guard.check()
    race.prepared.append(prepared)


@activity("timing a block")
def time_block(worker: Worker, number: int, reorders: bool) -> TimedBlock:
    """Run one block of a path, and compare what it returns.

    Args:
      number: its place in the order of preparation.
      reorders: whether a round begins.
    """
    race = worker.extension(RaceBlocks)
    if reorders:
        collect_garbage()
        race.case.reorder(race.rng)
    prepared, clock = race.prepared[number], time.perf_counter_ns
    prepared.clear()
    run = prepared.run
    begin = clock()
    run()
    ns = clock() - begin
    race.guard.check()
    difference = race.case.difference(prepared.final_states(), prepared)
    return TimedBlock(ns, f"in a timed block: {difference}" if difference else "")
