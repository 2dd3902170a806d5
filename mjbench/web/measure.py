"""Compare the WebAssembly builds with C of the same release on one model: agreement, then speed.

C draws the workload and steps it. Each build steps the same in a Node process of its own; one that
differs by more than rounding gets no speed. Then all that agree take turns in blocks, with C.
"""

import contextlib
import random
import statistics
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mjbench.comparison.plan import Variant
from mjbench.errors import Failure, MjbenchError, failure_of
from mjbench.host import child, files, machine
from mjbench.paired import cores
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.time_limit import ENDING_ERRORS, ending_of
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.web import c_reference, rounding_check
from mjbench.web.c_reference import CReference
from mjbench.web.node_process import NodeError
from mjbench.web.npm_package import Build
from mjbench.web.records import WebPathRecord, WebRecord
from mjbench.web.timed_build import ENGINE_THREADS, MIN_WARM_UP_S, BuildRun, Engine

# Rounds of blocks, at least and at most; both even.
_LEAST_ROUNDS, _MOST_ROUNDS = 8, 1000


@dataclass(frozen=True)
class WebPlan:
    """What is compared on each model."""

    release: ReleaseSpec
    engine: Engine
    sizes: Sizes
    budget_s: float


def variants() -> list[Variant]:
    """Return what is compared with C: each build, and the engine's own threads in the second."""
    chosen = [Variant(build.value, {}) for build in Build]
    nthread = machine.usable_cores()
    if nthread > 1:
        chosen.append(Variant(Build.WASM_MT.value, {ENGINE_THREADS: nthread}))
    return chosen


def measure(pool: WorkerPool, source: ModelSource, plan: WebPlan) -> WebRecord:
    """Return what was measured of a model.

    A build that fails costs its own row. After Ctrl-C, the record holds what was checked before.
    """
    measurement = _Measurement(pool, source, plan)
    try:
        with files.temporary_folder() as folder, contextlib.ExitStack() as closing:
            measurement.run(folder, closing)
    except ENDING_ERRORS as error:
        return measurement.record(ending_of(error))
    return measurement.record(Failure(Status.OK, ""))


class _Measurement:
    def __init__(self, pool: WorkerPool, source: ModelSource, plan: WebPlan):
        self._pool, self._source, self._plan = pool, source, plan
        self._reference: CReference | None = None
        self._paths: list[WebPathRecord] = []
        # builds that agree, by their position among the paths
        self._runs: dict[int, BuildRun] = {}

    def record(self, ending: Failure) -> WebRecord:
        plan, reference = self._plan, self._reference
        measured: dict[str, Any] = {}
        if reference is not None:
            nrow, nbatch, _ = reference.traced.run.states.shape
            measured = {
                "nbatch": nbatch,
                "nstep": nrow - 1,
                "block_nbatch": reference.block.nbatch,
                "block_nstep": reference.block.nstep,
                "workload_digest": reference.digest,
                "starts": reference.starts,
                "work": reference.work,
                "c_compile_ms": reference.compile_ms,
                "paths": self._paths,
            }
        return WebRecord(
            model=self._source.name,
            release=plan.release.version,
            node=plan.engine.node.version,
            status=ending.status,
            detail=ending.detail,
            hold=plan.sizes.hold,
            seed=plan.sizes.seed,
            **measured,
        )

    def run(self, folder: Path, closing: contextlib.ExitStack) -> None:
        plan = self._plan
        reference = c_reference.prepare(self._pool, plan.release, self._source, plan.sizes)
        self._reference = reference
        of_c = c_reference.variants()
        self._paths = [WebPathRecord(path=each.path, options=each.options) for each in of_c]
        for variant in variants():
            position = len(self._paths)
            run = BuildRun(
                plan.engine, variant, self._source.name, reference, folder / f"path{position}"
            )
            self._paths.append(self._checked(position, closing.enter_context(run)))
        core = cores.freest_core()
        with c_reference.timed_paths(self._pool, plan.release, reference, of_c, core) as processes:
            self._time(processes, core)

    def _checked(self, position: int, run: BuildRun) -> WebPathRecord:
        record = WebPathRecord(path=run.variant.path, options=run.variant.options)
        try:
            run.load()
            check = run.check()
            record = replace(record, check=check)
            if failed := rounding_check.failures(check):
                return replace(record, status=Status.DISAGREES, detail="; ".join(failed))
            run.prepare()
            least_s = min(MIN_WARM_UP_S, self._plan.budget_s)
            start_up = run.warm_up(least_s)
            run.check_blocks()
        except MjbenchError as error:
            return _failed(record, error)
        self._runs[position] = run
        return replace(record, start_up=start_up)

    def _time(self, processes: Sequence[WorkerProcess], core: int | None) -> None:
        blocks = {i: process.time_block for i, process in enumerate(processes)}
        for i, run in self._runs.items():
            blocks[i] = run.process.time_block
            if core is not None:
                run.process.confine([core])
        with cores.pinned(core):
            rows = rounds(blocks, self._plan.budget_s, self._drop, range(len(processes)))
        for i, run in self._runs.items():
            self._check_timed(i, run)
        for i, path in enumerate(self._paths):
            if path.status == Status.OK and i in blocks:
                self._paths[i] = replace(path, block_ns=[row[i] for row in rows if i in row])
        for i, process in enumerate(processes):
            rss_bytes = child.memory_bytes(process.pid) or None
            self._paths[i] = replace(self._paths[i], rss_bytes=rss_bytes)

    def _drop(self, position: int, error: NodeError) -> None:
        self._paths[position] = _failed(self._paths[position], error)
        del self._runs[position]

    def _check_timed(self, position: int, run: BuildRun) -> None:
        """Store the memory of a build, if all that it computed is what was checked."""
        path = self._paths[position]
        try:
            run.check_blocks()
            memory = run.process.memory()
        except MjbenchError as error:
            path = _failed(path, error)
        else:
            path = replace(path, heap_bytes=memory.heap_bytes, rss_bytes=memory.rss_bytes)
        self._paths[position] = path


def rounds(
    blocks: Mapping[int, Callable[[], int]],
    budget_s: float,
    on_failure: Callable[[int, NodeError], None],
    required: Collection[int] = (),
    rng: random.Random | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Mapping[int, int]]:
    """Time blocks in turns; return the nanoseconds of each round, by the keys of the blocks.

    Each two rounds have one random order and its opposite, so that each block follows each other
    one as often. A block that fails is left out from then on, and so are its unfinished rounds.
    After the least number of rounds, so is one that takes longer than all others together, unless
    it is required.

    Args:
      budget_s: seconds for all rounds; no two begin that would exceed them.
    """
    rng, going_on = rng or random.Random(), dict(blocks)
    rows: list[Mapping[int, int]] = []
    begin, longest_s = clock(), 0.0
    while len(rows) < _MOST_ROUNDS:
        pair_begin = clock()
        if len(rows) >= _LEAST_ROUNDS and pair_begin - begin + longest_s > budget_s:
            break
        order = rng.sample(sorted(going_on), len(going_on))
        pair: list[dict[int, int]] = [{}, {}]
        try:
            for row, turn in zip(pair, (order, order[::-1]), strict=True):
                for key in turn:
                    row[key] = going_on[key]()
            rows += pair
        except NodeError as error:
            on_failure(key, error)
            del going_on[key]
        longest_s = max(longest_s, clock() - pair_begin)
        longest = _longest(rows) if len(rows) == _LEAST_ROUNDS else None
        if longest in going_on and longest not in required:
            del going_on[longest]
            longest_s = 0.0
    return rows


def _longest(rows: Sequence[Mapping[int, int]]) -> int | None:
    """Return which block takes longer than all others together; None without one."""
    medians = {key: statistics.median(row[key] for row in rows) for key in rows[-1]}
    longest = max(medians, key=medians.__getitem__)
    others = sum(medians.values()) - medians[longest]
    return longest if len(medians) > 2 and medians[longest] > others else None


def _failed(record: WebPathRecord, error: MjbenchError) -> WebPathRecord:
    failure = error.failure if isinstance(error, NodeError) else failure_of(error)
    return replace(record, status=failure.status, detail=failure.detail)
