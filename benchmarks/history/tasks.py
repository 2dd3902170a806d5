"""What the history times in two releases: the steps of a model, or an operation.

All tasks of two releases share their launches, so that processes start once for all of them.
"""

import contextlib
import functools
import math
import pickle
import random
import statistics
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchmarks.history.release_ratios import (
    LaunchRatio,
    OperationRatioRecord,
    RatioRecord,
    StepRatioRecord,
)
from benchmarks.operations import Operation
from mjbench.errors import Failure, InputError, UnavailableError
from mjbench.paired import cores
from mjbench.paired.pair_launches import ProcessPair
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.target_pair import StepPair
from mjbench.paired.targets import Target
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import PortableWorkload
from mjbench.status import Status

ROLES = "reference", "release"
# Perturbed, as in all of the committed history: steps of other work are not compared.
SIZES = Sizes(perturbs=True)
# The reference and the release, in this order.
Processes = tuple[WorkerProcess, WorkerProcess]
Releases = tuple[ReleaseSpec, ReleaseSpec]


class ReleaseTask(ABC):
    """Something that is timed in two releases, the reference and another.

    Attributes:
      all_blocks_s: see `time_limit.quad_count`: the shortest so far. The number of blocks of a
        layout follows from it, so that a disturbed block does not decide it.
    """

    record_type: ClassVar[str]

    def __init__(self, releases: Releases):
        self.releases = releases
        self.launches: list[LaunchRatio] = []
        self.is_complete = False
        self.failure: Failure | None = None
        self.all_blocks_s = math.inf
        self._reference_ns: list[float] = []

    @property
    def nsection(self) -> int:
        return 1

    @property
    @abstractmethod
    def series(self) -> str:
        """See `RatioRecord.series`."""

    def prepare(self, pool: WorkerPool) -> None:  # noqa: B027 (most tasks need nothing)
        """Fix what is done, before the first launch.

        Raises:
          UnavailableError: the release cannot do it, although the reference can.
          InputError: neither can.
        """

    def equip(self, processes: Processes) -> None:  # noqa: B027
        """Have both processes of a launch read what they need."""

    @abstractmethod
    def lay_out(self, pair: ProcessPair) -> tuple[int, int]:
        """Have both processes ready to time blocks, with their memory laid out anew.

        Returns the nanoseconds of one block of each section, in the reference and in the release.
        """

    @abstractmethod
    def record(self, problem: str, seconds: float) -> RatioRecord:
        """Return what was measured; `problem` says why the libraries were not moved."""

    def add(self, launch: LaunchRatio, reference_ns: float) -> None:
        self.launches.append(launch)
        self._reference_ns.append(reference_ns)

    def close(self) -> None:  # noqa: B027
        """Remove what `prepare` stored."""

    def _common(self, model: str, problem: str, seconds: float) -> RatioRecord:
        reference, release = self.releases
        return RatioRecord(
            model=model,
            release=release.version,
            build=release.key,
            reference=reference.version,
            status=self.failure.status if self.failure else Status.OK,
            detail=self.failure.detail if self.failure else "",
            launches=self.launches,
            problem=problem,
            seconds=seconds,
        )

    def _reference_s(self, count: int) -> float | None:
        """Return the seconds of one of the `count` things that are timed, in the reference."""
        if not self._reference_ns:
            return None
        return 1e-9 * statistics.median(self._reference_ns) / count


class StepTask(ReleaseTask):
    """The steps of a model, on the reference's workload."""

    record_type = StepRatioRecord.record_type

    def __init__(self, releases: Releases, model: ModelSource):
        super().__init__(releases)
        self.model = model
        self._targets = Target(releases[0], model), Target(releases[1], model)
        self._pair: StepPair | None = None
        self._digest = ""

    @property
    def series(self) -> str:
        return self.model.name

    @property
    def nsection(self) -> int:
        return self._pair.nsection if self._pair else 1

    def prepare(self, pool: WorkerPool) -> None:
        try:
            pair = StepPair(pool, self._targets, SIZES, roles=ROLES)
            pair.fix_work()
        except InputError as error:
            # if the reference can do it, the release lacks something; if not, the model is wrong
            reference = self._targets[0]
            StepPair(pool, (reference, reference), SIZES, roles=ROLES).fix_work()
            raise UnavailableError(str(error)) from error
        self._pair = pair
        file = pair.workloads[0]
        workload: PortableWorkload = pickle.loads(file.read_bytes())
        self._digest = workload.digest()

    def equip(self, processes: Processes) -> None:
        assert self._pair is not None, "a task is prepared before it is timed"
        self._pair.equip(processes)
        with contextlib.ExitStack() as waiting:  # for both, also where one cannot read it
            for process in processes:
                waiting.callback(process.wait)

    def lay_out(self, pair: ProcessPair) -> tuple[int, int]:
        assert self._pair is not None, "a task is prepared before it is timed"
        return self._pair.lay_out(pair)

    def record(self, problem: str, seconds: float) -> StepRatioRecord:
        common = self._common(self.model.name, problem, seconds)
        record = StepRatioRecord(**vars(common), workload=self._digest)
        if self._pair is None:
            return record
        check = self._pair.work
        return replace(
            record,
            work=check.candidate,
            reference_work=check.baseline,
            diverged=check.diverged[1],
            reference_diverged=check.diverged[0],
            drift=check.drift.one_step if check.drift else None,
            run_drift=check.drift.runs if check.drift else (),
            nbatch=check.nbatch,
            nstep=check.nstep,
            starts=check.starts,
            reference_s=self._reference_s(check.nbatch * check.nstep),
        )

    def close(self) -> None:
        if self._pair is not None:
            self._pair.close()
            self._pair.workloads[0].unlink(missing_ok=True)


class OperationTask(ReleaseTask):
    """An operation around `mj_step`."""

    record_type = OperationRatioRecord.record_type

    def __init__(self, releases: Releases, operation: Operation):
        super().__init__(releases)
        self.operation = operation
        self._drift: float | None = None

    @property
    def series(self) -> str:
        return self.operation.name

    def lay_out(self, pair: ProcessPair) -> tuple[int, int]:
        operation = self.operation
        prepare = functools.partial(operation.prepare, operation.source, operation.repeats)
        allowed = cores.usable(pair.core)
        ready = {
            i: pair.processes[i].call(Worker.prepare_operation, prepare, allowed)
            for i in random.sample((0, 1), 2)
        }
        reference, release = ready[0], ready[1]
        self._drift = None
        if reference.result.shape == release.result.shape:
            self._drift = float(np.abs(reference.result - release.result).max(initial=0.0))
        return reference.ns, release.ns

    def record(self, problem: str, seconds: float) -> OperationRatioRecord:
        operation = self.operation
        common = self._common(operation.model, problem, seconds)
        record = OperationRatioRecord(
            **vars(common),
            operation=operation.name,
            title=operation.title,
            repeats=operation.repeats,
        )
        return replace(record, drift=self._drift, reference_s=self._reference_s(operation.repeats))


@dataclass(frozen=True)
class Selection:
    """What the history measures: steps of models, and operations, in each of the releases."""

    reference: ReleaseSpec
    releases: Sequence[ReleaseSpec]
    sources: Sequence[ModelSource]
    operations: Sequence[Operation]

    @property
    def names(self) -> list[str]:
        models = [source.name for source in self.sources]
        return [*models, *(operation.name for operation in self.operations)]

    @property
    def arguments(self) -> dict[str, object]:
        """What the header of the run file says."""
        return {
            "reference": self.reference.key,
            "releases": [release.key for release in self.releases],
            "models": [source.name for source in self.sources],
            "operations": bool(self.operations),
        }

    def tasks(self, release: ReleaseSpec) -> list[ReleaseTask]:
        releases = self.reference, release
        return [
            *(StepTask(releases, source) for source in self.sources),
            *(OperationTask(releases, operation) for operation in self.operations),
        ]
