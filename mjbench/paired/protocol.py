"""Two sides, alternated block by block in fresh processes: the engine of every comparison.

A launch is a program of each side, started anew. Both sit on one core, with this process, and take
turns in quads, ABBA or BAAB at random, so that drift and the order of turns hit both alike; a few
times each lays its memory out anew. A launch gives one number, the middle of its pairs' log
ratios; launches are the samples of which stats makes a verdict, and as many are made as the
verdict needs. While a launch is measured, the programs of the next start on the other cores.
"""

import contextlib
import os
import random
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mjbench.errors import InputError
from mjbench.instrument import machine
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess, place
from mjbench.paths import nthread
from mjbench.releases import installs
from mjbench.simulation import agreement
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import PortableWorkload

# A block is about this long, in seconds: the shorter, the closer a pair, and the fewer are hit by
# what else the machine does; the longer, the less its cold start weighs, which both sides have
# alike and which makes any change look smaller. Steps of one simulation.
BLOCK_S, MOST_NSTEP = 0.001, 100
# Simulations drawn for each one of a block: every layout does others, so that a verdict does not
# rest on the states of one.
STARTS = 8
# How often a launch lays out its memory anew, and for each time: the timed part in seconds, and the
# fewest and most quads it is made of. Layouts of one program differ about as much as programs do,
# and are had sooner.
LAYOUTS, LAYOUT_S, LEAST_QUADS, MOST_QUADS = 3, 0.1, 2, 100
# Paths with threads get blocks in which starting the threads is no longer what is measured.
THREADED_BLOCK_S = 0.01

# The cores that this process may use, before it pins itself to one.
_ALLOWED = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


@dataclass(frozen=True)
class Target:
    """What one of the two sides runs.

    Attributes:
      release: of MuJoCo.
      model: to load.
      path: way of stepping.
      options: of the path.
      model_options: fields of `model.opt` to set, by name.
      slowdown: share of the simulations done once more, a slowdown of known size.
    """

    release: installs.ReleaseSpec
    model: ModelSource
    path: str = "python_loop"
    options: Mapping[str, Any] = field(default_factory=dict)
    model_options: Mapping[str, str] = field(default_factory=dict)
    slowdown: float = 0.0

    @property
    def threads(self) -> int:
        """Return how many threads, or processes, it steps with."""
        return nthread(self.options)

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return {
            "release": self.release.version,
            "model": self.model.name,
            "path": self.path,
            "options": dict(self.options),
            "model_options": dict(self.model_options),
            "slowdown": self.slowdown,
        }


@dataclass(frozen=True)
class Sizes:
    """The work of a block; None is chosen from what a step costs."""

    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Launch:
    """What one launch measured.

    Attributes:
      core: that both sides ran on; None where they may use all.
      cores: that as many threads as the sides have got just before; None for one thread.
      orders: of each quad, `ABBA` or `BAAB`; A is the old side. Layout by layout.
      ns: (quads, 4) nanoseconds of each block, in the order they ran.
    """

    core: int | None
    cores: float | None
    orders: Sequence[str]
    ns: np.ndarray

    def log_ratios(self) -> np.ndarray:
        """(quads, 2) natural logarithms of new over old time: old first, and new first."""
        logs = np.log(self.ns)
        sign = np.array([[1 if c == "B" else -1 for c in order] for order in self.orders])
        pairs = (logs * sign).reshape(-1, 2, 2).sum(axis=2)
        new_first = np.array([order[0] == "B" for order in self.orders])
        pairs[new_first] = pairs[new_first, ::-1]
        return np.asarray(pairs)

    @property
    def value(self) -> float:
        """The launch's log ratio: the median of pairs, for each order, and the mean of the two.

        What comes second is slower, so the orders must weigh the same. A disturbed block spoils a
        pair; a quad would be spoilt twice as often.
        """
        return float(np.median(self.log_ratios(), axis=0).mean())

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON-ready values."""
        return asdict(self) | {"ns": self.ns.tolist()}


@dataclass(frozen=True)
class WorkCheck:
    """Whether both sides do the same work.

    Attributes:
      old: contacts, constraints, solver iterations per step.
      new: the same.
      drift: largest difference of qpos, qvel, act one step after the same states, in SI units;
        None where the sides have different models.
      diverged: simulations that diverged on the old side, and on the new one; none of those is
        timed.
      nbatch: simulations of a block.
      nstep: steps of each.
    """

    old: Mapping[str, float]
    new: Mapping[str, float]
    drift: float | None
    diverged: tuple[int, int]
    nbatch: int
    nstep: int


class TargetPair:
    """Two sides, ready to be launched as often as it takes.

    Attributes:
      same: whether they do the same work.
      works: files of the pool with each side's workload (see workload.portable) and final states;
        after `close` the old side's alone.
    """

    def __init__(self, pool: WorkerPool, old: Target, new: Target, sizes: Sizes = Sizes()):
        """Load the models, and make sure that both sides can do the same work.

        Raises:
          InputError: a side cannot do it.
          TargetError: a side crashed, hung or failed.
        """
        self.pool, self.sides, self.sizes = pool, (old, new), sizes
        self.threads = max(old.threads, new.threads)
        self._next: list[WorkerProcess] = []
        self._calibrator: WorkerProcess | None = None
        self._models: list[Path] = []
        self.works: list[Path] = []
        both: list[WorkerProcess] = []
        try:
            both.extend(self._started(i) for i in (0, 1))
            self._begin(both)
        finally:
            pool.end(both)

    def launch(self) -> Launch:
        """Measure once, in fresh processes."""
        if not self._next:
            self._ahead()
        both, self._next = self._next, []
        try:
            for process, side in zip(both, self.sides, strict=True):
                self.pool.started(process, side.release)
            # all cores belong to sides with threads: what starts meanwhile would be in their way
            cores = self._cores() if self.threads > 1 else None
            core = None if self.threads > 1 else freest_core()
            others = core is not None and machine.usable_cores() > 1
            with _pinned(core):
                if others:
                    self._ahead({c for c in _ALLOWED if c != core})
                layouts = [self._layout(both, core) for _ in range(LAYOUTS)]
            place(self._next, _ALLOWED)
        finally:
            self.pool.end(both)
        orders = [order for found, _ in layouts for order in found]
        return Launch(core, cores, orders, np.concatenate([ns for _, ns in layouts]))

    def close(self) -> None:
        """End the processes that were started ahead; drop the models, and the new side's work."""
        self.pool.end(self._next)
        self._next = []
        if self._calibrator is not None:
            self.pool.end([self._calibrator])
            self._calibrator = None
        for file in (*self._models, *self.works[1:]):
            file.unlink(missing_ok=True)

    def _started(self, i: int) -> WorkerProcess:
        side = self.sides[i]
        name = f"{('old', 'new')[i]} side (MuJoCo {side.release.version}, {side.model.name})"
        return self.pool.start(side.release, name)

    def _ahead(self, cores: set[int] = _ALLOWED) -> None:
        """Start the processes of a launch, without waiting for them."""
        made: dict[int, WorkerProcess] = {}
        try:
            for i in random.sample((0, 1), 2):  # in whatever order: none is always the first
                made[i] = self._started(i)
                place([made[i]], cores)
                made[i].ask("equip", model=str(self._models[i]), work=str(self.works[i]))
        except BaseException:
            self.pool.end(list(made.values()))
            raise
        self._next = [made[0], made[1]]

    def _begin(self, both: Sequence[WorkerProcess]) -> None:
        """Make the workload; see what each side does with it."""
        for process, side in zip(both, self.sides, strict=True):
            self.pool.started(process, side.release)
        self._models = [self.pool.file(".mjb") for _ in both]
        for process, side, file in zip(both, self.sides, self._models, strict=True):
            process.call(
                "load",
                name=side.model.name,
                path=str(side.model.path),
                options=dict(side.model_options),
            )
            process.call("save", path=str(file))
        nbatch, nstep = self._sizes(*(process.call("cost") for process in both))
        drawn = nbatch if self.sizes.nbatch or self.threads > 1 else STARTS * nbatch
        making = {"nbatch": drawn, "nstep": nstep}
        making |= {"hold": self.sizes.hold, "seed": self.sizes.seed}
        works = self._shared(both, making)
        shared = works[0] is works[1]
        seen: list[dict[str, Any]] = []
        for process, work in zip(both, works, strict=True):
            with self.pool.kept(work) as file:
                seen.append(process.call("observe", work=str(file)))
        kept = self._kept([s["healthy"] for s in seen], [s["diagnosis"] for s in seen], shared)
        self.works = [
            self.pool.keep(work.only(rows, s["final"]))
            for work, s, rows in zip(works, seen, kept, strict=True)
        ]
        self._nsim, self._nbatch = len(kept[0]), min(nbatch, len(kept[0]))
        after = [{field: values[kept[0]] for field, values in s["after"].items()} for s in seen]
        alike = all(after[0][k].shape == after[1][k].shape for k in after[0])
        self.work_check = WorkCheck(
            seen[0]["work"],
            seen[1]["work"],
            agreement.drift(after[1], after[0]) if shared and alike else None,
            (int((~seen[0]["healthy"]).sum()), int((~seen[1]["healthy"]).sum())),
            self._nbatch,
            nstep,
        )

    def _shared(
        self, both: Sequence[WorkerProcess], making: Mapping[str, Any]
    ) -> list[PortableWorkload]:
        """Return the workload of each side: one for both, unless their models differ in size."""
        made = both[0].call("make", **making)
        try:
            with self.pool.kept(made) as file:
                both[1].call("take", work=str(file))
        except InputError:
            if self.sides[0].model == self.sides[1].model:
                raise
            return [made, both[1].call("make", **making)]
        return [made, made]

    def _kept(
        self, healthy: Sequence[np.ndarray], diagnoses: Sequence[str], shared: bool
    ) -> list[np.ndarray]:
        """Return which simulations each side does: as many, and none that diverges."""
        for side, fine, diagnosis in zip(self.sides, healthy, diagnoses, strict=True):
            if not fine.any():
                raise InputError(
                    f"{side.model.name} with MuJoCo {side.release.version}: every simulation"
                    f" diverges ({diagnosis}); there is nothing to compare"
                )
        if shared:
            rows = np.flatnonzero(healthy[0] & healthy[1])
            if len(rows) == 0:
                raise InputError("no simulation stays whole on both sides: nothing to compare")
            return [rows, rows]
        first, second = (np.flatnonzero(fine) for fine in healthy)
        count = min(len(first), len(second))
        return [first[:count], second[:count]]

    def _layout(
        self, both: Sequence[WorkerProcess], core: int | None
    ) -> tuple[list[str], np.ndarray]:
        """Time some quads with memory laid out anew; return their orders and (quads, 4) ns."""
        rows = random.sample(range(self._nsim), self._nbatch)
        warm_ns = 0
        for i in random.sample((0, 1), 2):
            side = self.sides[i]
            warm_ns += both[i].call(
                "prepare",
                path=side.path,
                options=dict(side.options),
                cores=sorted(_ALLOWED) if core is None else [core],
                rows=rows + random.choices(rows, k=round(side.slowdown * self._nbatch)),
            )
        quads = int(1e9 * LAYOUT_S / (2 * warm_ns))
        return _quads(both[0], both[1], min(max(quads, LEAST_QUADS), MOST_QUADS))

    def _sizes(self, *step_s: float) -> tuple[int, int]:
        """Return simulations and steps of each, so that a block takes about BLOCK_S."""
        hold, threads = self.sizes.hold, self.threads
        block_s = BLOCK_S if threads == 1 else threads * THREADED_BLOCK_S
        steps = max(1, int(block_s / max(step_s)))
        if self.sizes.nbatch:
            nbatch = self.sizes.nbatch
            return nbatch, self.sizes.nstep or hold * max(1, steps // nbatch // hold)
        nstep = self.sizes.nstep or hold * max(1, min(steps, MOST_NSTEP) // hold)
        return max(1 if threads == 1 else 4 * threads, steps // nstep), nstep

    def _cores(self) -> float:
        """Return how many cores as many threads as the sides have get now."""
        threads = min(machine.usable_cores(), self.threads)
        if threads == 1:
            return 1.0
        if self._calibrator is None:  # a process of its own: calibrating allocates
            self._calibrator = self.pool.start(self.sides[0].release)
            self._calibrator.answers()
        return float(self._calibrator.call("cores", threads=threads))


def _quads(old: WorkerProcess, new: WorkerProcess, count: int) -> tuple[list[str], np.ndarray]:
    """Time `count` quads; return their orders and (count, 4) nanoseconds."""
    sides = {"A": old, "B": new}
    for side in sides.values():
        side.ask("time")
    orders = [random.choice(("ABBA", "BAAB")) for _ in range(count)]
    ns = np.array([[sides[letter].block() for letter in order] for order in orders])
    for side in sides.values():
        side.blocks_end()
    return orders, ns


def freest_core(seconds: float = 0.01) -> int | None:
    """Return the core, of those this process may use, that others leave most of; None if unknown.

    It is the one on which a busy loop got the largest share of the time: of more time than Linux
    gives a newcomer before it lets others on again, some milliseconds.
    """
    if not hasattr(os, "sched_setaffinity"):
        return None
    allowed = sorted(os.sched_getaffinity(0))
    shares: dict[int, float] = {}
    for core in random.sample(allowed, min(len(allowed), 8)):
        with _pinned(core):
            begin, used = time.perf_counter(), time.thread_time()
            while time.perf_counter() - begin < seconds:
                pass
            shares[core] = (time.thread_time() - used) / (time.perf_counter() - begin)
    best = max(shares.values())
    return random.choice([core for core, share in shares.items() if share > best - 0.02])


@contextlib.contextmanager
def _pinned(core: int | None) -> Iterator[None]:
    """Keep this process on one core while the block runs."""
    if core is None:
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, [core])
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
