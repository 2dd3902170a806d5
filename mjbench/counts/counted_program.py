"""The program that Callgrind counts: it does its tasks between calls of a marker function.

It runs inside the environment of any release (see instructions.py). It does each task, the steps of
a model or an operation around the step, once to warm up, then twice between markers. Callgrind's
options make it write out its counts, and start again from zero, whenever the marker is called. Only
the work and the markers run with its instrumentation, where that can be switched: without it,
Callgrind runs a program several times faster, and counts nothing.
"""

import ctypes
import gc
import mmap
import pickle
import platform
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import mujoco
import numpy as np

from mjbench import paths
from mjbench.errors import Failure, MjbenchError, failure_of
from mjbench.paired.operations import Prepare
from mjbench.releases import install_check
from mjbench.simulation import models, reference_run, state_drift, workload, workload_sampling
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import Starts
from mjbench.simulation.state_drift import Followed
from mjbench.simulation.workload_sampling import SampleRequest
from mjbench.verification.plan import check_memory

# A function of the engine that nothing else calls, and how often it is called for each task.
MARKER = "mj_version"
MARKERS = 3
# How often an operation is done first. Python rewrites the code of its loop meanwhile.
WARM_UPS = 10
# The way of stepping that is counted.
PATH = paths.BASE
# Of callgrind.h: the base of its requests, and their numbers.
_BASE = ord("C") << 24 | ord("T") << 16
_START, _STOP = _BASE + 4, _BASE + 5
# A function of the address of a request: six numbers of 64 bits, the request first.
_X86_64 = bytes.fromhex(
    "4889f8"  # mov rax, rdi
    "31d2"  # xor edx, edx
    "48c1c703 48c1c70d 48c1c73d 48c1c733"  # rol rdi by 3, 13, 61 and 51: together, nothing
    "4887db"  # xchg rbx, rbx
    "4889d0"  # mov rax, rdx
    "c3"  # ret
)


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
    """An operation around the step, which `prepare` makes ready to be done `repeats` times."""

    operation: str
    source: ModelSource
    prepare: Prepare
    repeats: int


# What is counted between the markers of one turn.
TaskRequest = ModelRequest | OperationRequest


@dataclass(frozen=True, eq=False)
class CountedWork:
    """What was done between two markers.

    Attributes:
      warnings: how many of the simulations that did not diverge raised each warning, by its name.
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


# What became of a task: the work whose instructions Callgrind wrote out, None for an operation, or
# why there is none.
CountAnswer = CountedWork | Failure | None


def can_switch_instrumentation() -> bool:
    return sys.platform == "linux" and platform.machine() == "x86_64"


class Instrumentation:
    """Callgrind's instrumentation of this process, off at first where it can be switched.

    A program asks for the change by instructions that do nothing outside Valgrind
    (`VALGRIND_DO_CLIENT_REQUEST` of valgrind.h, and callgrind.h).
    """

    def __init__(self) -> None:
        self._request = None
        if can_switch_instrumentation():
            self._code = mmap.mmap(
                -1, len(_X86_64), prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
            )
            self._code.write(_X86_64)
            address = ctypes.addressof(ctypes.c_char.from_buffer(self._code))
            self._request = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p)(address)

    def start(self) -> None:
        self._ask(_START)

    def stop(self) -> None:
        self._ask(_STOP)

    def _ask(self, request: int) -> None:
        if self._request is not None:
            arguments = (ctypes.c_uint64 * 6)(request)
            self._request(ctypes.addressof(arguments))


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
    try:
        if isinstance(task, OperationRequest):
            _operate_between_markers(task, instrumentation)
            return None
        return _step_between_markers(task, instrumentation)
    except MjbenchError as error:
        instrumentation.start()
        for _ in range(MARKERS):  # dumps are numbered: the next task's must have theirs
            mujoco.mj_version()
        instrumentation.stop()
        return failure_of(error)


def _step_between_markers(request: ModelRequest, instrumentation: Instrumentation) -> CountedWork:
    model = models.load(request.source)
    shared, probe, starts = _workload(model, request)
    observation = reference_run.observe(shared)
    run = paths.find(PATH).prepare(shared, {}, paths.Resources(shared)).run
    _run_between_markers(run, instrumentation)
    return CountedWork(
        steps=shared.steps,
        work=observation.work,
        diverged=int((~observation.healthy).sum()),
        warnings=observation.other_warnings(),
        healthy=observation.healthy,
        followed=None if probe is None else state_drift.follow(shared, probe),
        starts=starts,
    )


def _operate_between_markers(request: OperationRequest, instrumentation: Instrumentation) -> None:
    run = request.prepare(request.source, request.repeats).run
    gc.disable()  # when it would run depends on what ran before
    for _ in range(WARM_UPS):
        run()
    _run_between_markers(run, instrumentation)


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
    file, starts = request.workload_file, None
    if not file.is_file():
        check_memory(model, request.sample.nbatch, request.sample.nstep)
        sample = workload_sampling.draw(model, request.sample)
        created, starts = state_drift.portable(sample.workload), sample.starts
        partial = file.with_suffix(".part")  # a killed program must leave no half of a file
        partial.write_bytes(pickle.dumps(created))
        partial.rename(file)
    # read back even if it was just created: every release restores the same numbers
    portable: workload.PortableWorkload = pickle.loads(file.read_bytes())
    return workload.restore(model, portable), portable.probe, starts
