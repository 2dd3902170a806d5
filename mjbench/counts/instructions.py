"""Count instructions per step with Callgrind, by function: exact on the noisiest machine.

One process under Callgrind (counted_program.py) steps all models of a release. Callgrind writes out
its counts at each call of a marker; between two markers of a model lies one pass over its workload
by a Python loop. `mj_step` with all that it calls is the engine; the rest is the bindings and
Python. Operations around the step are counted likewise, but as a whole. Counts repeat to about
1e-4, and a second pass checks that for each. They say what the code did, not how long it took:
cache misses, mispredicted branches and system calls take time without taking instructions.
"""

import contextlib
import shutil
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from mjbench.counts import callgrind, counted_program
from mjbench.counts.callgrind import CallgrindProfile
from mjbench.counts.counted_program import (
    CountAnswer,
    CountedWork,
    ModelRequest,
    OperationRequest,
    TaskRequest,
)
from mjbench.counts.records import InstructionsRecord
from mjbench.counts.stages import ENGINE, instructions_by_stage
from mjbench.errors import Failure, MachineError, writing
from mjbench.host import child, child_connection, files, machine, platforms
from mjbench.host.child_connection import ChildConnection, ChildError
from mjbench.paired import release_python
from mjbench.paired.run_sizes import Sizes
from mjbench.releases import installs, release_names
from mjbench.simulation.models import ModelSource
from mjbench.simulation.state_drift import Followed
from mjbench.simulation.workload import whole_holds
from mjbench.simulation.workload_sampling import SampleRequest
from mjbench.status import Status

# Simulations and steps of each, unless the sizes say otherwise. Callgrind runs about fifty times
# slower than the processor.
NBATCH, NSTEP = 2, 50
# The same number of steps from a file of states: what it holds is seen at more places.
NBATCH_OF_FILE, NSTEP_OF_FILE = 10, 10
# Steps of the run along which starts are sampled, at most: they are counted as slowly.
MAX_SETTLING_NSTEP = 2000
# A random hash seed changes how Python's dictionaries collide, and with that the counts.
HASH_SEED = "0"
# Above these thresholds glibc copies and clears memory with one instruction, `rep movsb` or
# `rep stosb`, which Callgrind counts once for every byte: apparent changes of 50 %. No block
# reaches a gigabyte.
_NEVER_BYTES = 1_000_000_000
TUNABLES = (
    f"glibc.cpu.x86_rep_stosb_threshold={_NEVER_BYTES}"
    f":glibc.cpu.x86_rep_movsb_threshold={_NEVER_BYTES}"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelCount(InstructionsRecord):
    """What one model's steps cost in one release: a record, and what two releases compare.

    Of an operation around the step, it is what doing it once costs.

    Attributes:
      libraries: a file that has the code of each function, by name.
      calls: (caller, callee) of the functions that were executed.
      healthy: (nbatch,) bool: the simulations that did not diverge; None where the model was not
        counted.
      followed: what the release did from the states of the workload's probe; None likewise.
    """

    operation: str = ""
    libraries: Mapping[str, str] = field(default_factory=dict)
    calls: AbstractSet[tuple[str, str]] = frozenset()
    healthy: np.ndarray | None = None
    followed: Followed | None = None

    def record(self) -> InstructionsRecord:
        values = {each.name: getattr(self, each.name) for each in fields(InstructionsRecord)}
        return InstructionsRecord(**values)


def unavailable() -> str | None:
    """Return why instructions cannot be counted here, in one line, or None if they can."""
    if not platforms.can_count_instructions():
        return "counting instructions needs Linux, because it needs valgrind"
    if shutil.which("valgrind"):
        return None
    return "counting instructions needs valgrind: install it, such as by `apt install valgrind`"


class InstructionCounter:
    """Counts models, each with the same workload in every release; used as a context manager.

    The workload is the one that `use_workload` set; otherwise the first release that counts the
    model creates it.
    """

    def __init__(self, sizes: Sizes | None = None):
        self._sizes = sizes or Sizes()
        self._workload_files: dict[ModelSource, Path] = {}
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> "InstructionCounter":
        """Create a folder for workloads; MachineError without valgrind, or a folder."""
        problem = unavailable()
        if problem:
            raise MachineError(problem)
        self._folder = self._closing.enter_context(files.temporary_folder())
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def use_workload(self, source: ModelSource, file: Path) -> None:
        """Set the workload of a model: a pickle of what `workload.portable` returns."""
        self._workload_files[source] = file

    def count(
        self,
        release: release_names.ReleaseSpec,
        work: Sequence[ModelSource | OperationRequest],
        limit_s: float = 600.0,
    ) -> Iterator[ModelCount]:
        """Yield what work takes; a process that finishes nothing for `limit_s` is killed."""
        requests = [
            each if isinstance(each, OperationRequest) else self._request(each) for each in work
        ]
        return _count(release, requests, limit_s)

    def _request(self, source: ModelSource) -> ModelRequest:
        unused = self._folder / f"{len(self._workload_files)}.pickle"
        sizes = self._sizes
        of_file = NBATCH_OF_FILE, NSTEP_OF_FILE
        nbatch, nstep = (NBATCH, NSTEP) if sizes.starts.file is None else of_file
        sample = SampleRequest(
            sizes.nbatch or nbatch,
            sizes.nstep or whole_holds(nstep, sizes.hold),
            sizes.hold,
            sizes.seed,
            sizes.starts,
            MAX_SETTLING_NSTEP,
            may_shorten=sizes.nstep is None,
        )
        return ModelRequest(source, self._workload_files.setdefault(source, unused), sample)


def _count(
    release: release_names.ReleaseSpec, requests: Sequence[TaskRequest], limit_s: float
) -> Iterator[ModelCount]:
    done = 0
    while done < len(requests):
        # a task that ends the process costs only its own row: a new process counts the rest
        with files.temporary_folder() as folder:
            for count in _count_until_death(release, requests[done:], folder, limit_s):
                yield count
                done += 1


def _count_until_death(
    release: release_names.ReleaseSpec, tasks: Sequence[TaskRequest], folder: Path, limit_s: float
) -> Iterator[ModelCount]:
    """Count tasks until one ends the process; the last count then says how."""
    begin_s = time.monotonic()
    with _program(release, tasks, folder, limit_s) as connection:
        for number, task in enumerate(tasks):
            answer: CountAnswer
            has_ended = False
            try:
                answer = connection.unpickled(connection.receive(limit_s))
            except ChildError as error:
                hung = error.ending == Status.TIMEOUT
                answer = Failure(error.ending, f"{error.cause}, killed" if hung else str(error))
                has_ended = True
            # numbered from 1; each task's first one holds what came before its passes
            first = counted_program.MARKERS * number + 2
            passes = range(first, first + counted_program.MARKERS - 1)
            dumps = [folder / f"callgrind.out.{dump}" for dump in passes]
            end_s = time.monotonic()
            yield replace(_task_count(release, task, answer, dumps), seconds=end_s - begin_s)
            begin_s = end_s
            if has_ended:
                return


@contextlib.contextmanager
def _program(
    release: release_names.ReleaseSpec, tasks: Sequence[TaskRequest], folder: Path, limit_s: float
) -> Iterator[ChildConnection]:
    """Run the counted program under Callgrind as long as the block lasts; yield its connection.

    The dumps become `callgrind.out.1`, `callgrind.out.2`, … in the folder.
    """
    core = folder / "core"
    with writing(folder):
        core.mkdir()
        release_python.link_mjbench(core)
    with installs.use(release) as install:

        def command(descriptor: int) -> list[str]:
            code = f"from mjbench.counts.counted_program import main; main({descriptor})"
            program = [*_callgrind(folder), *release_python.command(code, core, install)]
            return child.ending_with_parent(program)

        connection = child_connection.start(
            command,
            folder / "output.txt",
            limit_s,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            env=release_python.environment(install)
            | {
                "GLIBC_TUNABLES": TUNABLES,
                "PYTHONHASHSEED": HASH_SEED,
                "TMPDIR": str(folder),  # valgrind's own temporary files go with the folder
            },
        )
        try:
            with contextlib.suppress(OSError):  # its end is reported where its answer is read
                connection.connection.send((release.version, tuple(tasks)))
            yield connection
        finally:
            connection.end()


def _callgrind(folder: Path) -> list[str]:
    return [
        *("valgrind", "--tool=callgrind", "--quiet"),
        f"--dump-before={counted_program.MARKER}",
        f"--instr-atstart={'no' if counted_program.can_switch_instrumentation() else 'yes'}",
        f"--callgrind-out-file={folder / 'callgrind.out'}",
    ]


def _task_count(
    release: release_names.ReleaseSpec,
    task: TaskRequest,
    answer: CountAnswer,
    dumps: Sequence[Path],
) -> ModelCount:
    empty = ModelCount(
        model=task.source.name,
        operation=task.operation if isinstance(task, OperationRequest) else "",
        release=release.version,
        build=release.key,
    )
    if isinstance(answer, Failure):
        return replace(empty, status=answer.status, detail=answer.detail)
    profile, repeated = (callgrind.parse(machine.read_text(dump)) for dump in dumps)
    if isinstance(task, OperationRequest):
        return _operation_count(empty, task.repeats, profile, repeated)
    assert answer is not None, "it is that of a model"
    return _model_count(empty, answer, profile, repeated)


def _operation_count(
    empty: ModelCount, repeats: int, profile: CallgrindProfile, repeated: CallgrindProfile
) -> ModelCount:
    """Return the count of one operation: the mean of its two passes.

    Some work may move from one pass to the other. Once, it was 3 % of the instructions of a load,
    and the mean was right.
    """
    both = profile + repeated
    executed = {name for name, cost in both.self_cost.items() if cost}
    return replace(
        empty,
        instructions_per_step=both.total / (2 * repeats),
        functions=both.counts(executed, 2 * repeats),
        repeats=abs(repeated.total - profile.total) / max(1, profile.total),
        libraries=both.libraries,
        calls={arc for arc in both.arcs if executed.issuperset(arc)},
    )


def _model_count(
    empty: ModelCount, counted: CountedWork, profile: CallgrindProfile, repeated: CallgrindProfile
) -> ModelCount:
    steps, engine = counted.steps, profile.inclusive_cost[ENGINE]
    if engine == 0:
        raise MachineError(f"Callgrind saw no {ENGINE} in MuJoCo {empty.release}")
    of_engine = profile.reachable_from(ENGINE)
    executed = {name for name in of_engine if profile.self_cost.get(name)}
    return replace(
        empty,
        instructions_per_step=engine / steps,
        outside_per_step=(profile.total - engine) / steps,
        functions=profile.counts(of_engine, steps),
        stages={stage: cost / steps for stage, cost in instructions_by_stage(profile).items()},
        steps=steps,
        work=counted.work,
        repeats=abs(repeated.inclusive_cost[ENGINE] / engine - 1),
        diverged=counted.diverged,
        warnings=counted.warnings,
        starts=counted.starts,
        libraries=profile.libraries,
        calls={arc for arc in profile.arcs if executed.issuperset(arc)},
        healthy=counted.healthy,
        followed=counted.followed,
    )
