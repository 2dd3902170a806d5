"""The program that Callgrind counts: it does its tasks between calls of a marker function.

It runs inside the environment of any release (see instructions.py). It does each task, the steps of
a model or an operation around the step, once to warm up, then twice between markers. Callgrind's
options make it write out its counts, and start again from zero, whenever the marker is called. Only
the work and the markers run with its instrumentation, where that can be switched.
"""

import gc
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import mujoco
import numpy as np

from mjbench import paths
from mjbench.comparison.sizes import check_memory
from mjbench.counts.instrumentation import Instrumentation
from mjbench.errors import Failure, MjbenchError, failure_of
from mjbench.paired import operations
from mjbench.releases import install_check
from mjbench.simulation import models, sampling, work, work_check, workload
from mjbench.simulation.models import ModelSource
from mjbench.simulation.sampling import SampleRequest
from mjbench.simulation.starts import Starts
from mjbench.simulation.work import Work
from mjbench.simulation.work_check import Followed

# A function of the engine that nothing else calls, and how often it is called for each task.
MARKER = "mj_version"
MARKERS = 3
# How often an operation is done first. Python rewrites the code of its loop meanwhile.
WARM_UPS = 10
# The way of stepping that is counted.
PATH = paths.BASE


@dataclass(frozen=True)
class ModelRequest:
    """A model to count, and its workload.

    Attributes:
      workload_file: a pickle of `workload.portable`; the program creates it where it is missing.
    """

    source: ModelSource
    workload_file: Path
    sample: SampleRequest


@dataclass(frozen=True)
class OperationRequest:
    """An operation around the step; `source` is None where it builds its own model."""

    operation: str
    source: ModelSource | None


# What is counted between the markers of one turn.
TaskRequest = ModelRequest | OperationRequest


@dataclass(frozen=True, eq=False)
class CountedWork:
    """What was done between two markers.

    Attributes:
      steps: number of steps of one pass.
      warnings: how many of the others raised each warning, by its name.
      healthy: (nbatch,) bool: the simulations that did not diverge.
      followed: what the release did from the states of the workload's probe; None without one.
      starts: where start states came from; None where another process drew them.
    """

    steps: int
    work: Work
    diverged: int
    warnings: Mapping[str, int]
    healthy: np.ndarray
    followed: Followed | None
    starts: Starts | None = None


@dataclass(frozen=True)
class CountedOperation:
    """An operation that was done between two markers."""

    repeats: int


# What became of a task: the work whose instructions Callgrind wrote out, or why there is none.
CountAnswer = CountedWork | CountedOperation | Failure


def main(descriptor: int) -> None:
    """Do the tasks that come over a connection, with the version of the release; answer each."""
    connection = Connection(descriptor)
    version, tasks = connection.recv()
    problem = install_check.imported_problem(version)
    if problem:
        raise SystemExit(problem)
    instrumentation = Instrumentation()
    for task in tasks:
        connection.send(_answer(task, instrumentation))


def _answer(task: TaskRequest, instrumentation: Instrumentation) -> CountAnswer:
    """Do one task; return what was done, or why it could not be done."""
    try:
        if isinstance(task, OperationRequest):
            return _operate_between_markers(task, instrumentation)
        return _step_between_markers(task, instrumentation)
    except MjbenchError as error:
        instrumentation.start()
        for _ in range(MARKERS):  # dumps are numbered: the next task's must have theirs
            mujoco.mj_version()
        instrumentation.stop()
        return failure_of(error)


def _step_between_markers(request: ModelRequest, instrumentation: Instrumentation) -> CountedWork:
    model = models.load(request.source)
    shared, probe, came_from = _workload(model, request)
    observation = work.observe(shared)
    run = paths.find(PATH).prepare(shared, {}, paths.Resources(shared)).run
    _run_between_markers(run, instrumentation)
    return CountedWork(
        steps=shared.steps,
        work=observation.work,
        diverged=int((~observation.healthy).sum()),
        warnings=observation.other_warnings(),
        healthy=observation.healthy,
        followed=None if probe is None else work_check.follow(shared, probe),
        starts=came_from,
    )


def _operate_between_markers(
    request: OperationRequest, instrumentation: Instrumentation
) -> CountedOperation:
    operation = operations.registry()[request.operation]
    run = operation.prepared(request.source.path if request.source else Path()).run
    gc.disable()  # when it would run depends on what ran before
    for _ in range(WARM_UPS):
        run()
    _run_between_markers(run, instrumentation)
    return CountedOperation(operation.repeats)


def _run_between_markers(run: Callable[[], object], instrumentation: Instrumentation) -> None:
    instrumentation.start()
    for _ in range(MARKERS):  # the first time to warm up
        run()
        mujoco.mj_version()
    instrumentation.stop()


def _workload(
    model: mujoco.MjModel, request: ModelRequest
) -> tuple[workload.Workload, Mapping[str, np.ndarray] | None, Starts | None]:
    """Return the workload of a request, its probe if it has one, and where its starts came from.

    A missing file is created; of any other it is not known where its starts came from.
    """
    file, came_from = request.workload_file, None
    if not file.is_file():
        check_memory(model, request.sample.nbatch, request.sample.nstep)
        sample = sampling.draw(model, request.sample)
        created, came_from = work_check.portable(sample.workload), sample.starts
        partial = file.with_suffix(".part")  # a killed program must leave no half of a file
        partial.write_bytes(pickle.dumps(created))
        partial.rename(file)
    # read back even if it was just created: every release restores the same numbers
    portable: workload.PortableWorkload = pickle.loads(file.read_bytes())
    return workload.restore(model, portable), portable.probe, came_from
