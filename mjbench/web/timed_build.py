"""A WebAssembly build in a Node process: started, checked against C, warmed up, timed."""

import itertools
import shutil
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjbench.comparison.plan import Variant
from mjbench.errors import Failure, MachineError, UnavailableError, writing
from mjbench.status import Status
from mjbench.web import rounding_check
from mjbench.web.c_reference import CReference
from mjbench.web.node_process import Instantiated, NodeError, NodeProcess, NodeProgram, Steps
from mjbench.web.npm_package import Build, NpmPackage
from mjbench.web.records import StartUp
from mjbench.web.rounding_check import RoundingCheck

# The option of a path that has the engine step one simulation on several threads.
ENGINE_THREADS = "engine_threads"
# Warming up takes at least so many seconds, unless less was asked for, and at most so many.
MIN_WARM_UP_S, _MAX_S = 1.0, 10.0
# It is over when the median of so many blocks is no less than this share of that of those before.
_WINDOW, _STEADY = 10, 0.97
# The first block that takes no longer than so many times the last ones is about as fast.
_NEARLY_STEADY = 1.1


@dataclass(frozen=True)
class Engine:
    """The builds of a release, and what runs them."""

    package: NpmPackage
    node: NodeProgram
    limit_s: float
    nthread: int


class BuildRun:
    """One variant of a build on one model; a context manager that ends its processes.

    Its methods raise NodeError where a process fails, crashes or hangs, and MachineError where none
    can be started or files cannot be written.
    """

    def __init__(
        self, engine: Engine, variant: Variant, model: str, reference: CReference, folder: Path
    ):
        self.variant = variant
        self._engine, self._model, self._reference = engine, model, reference
        self._folder = folder
        self._processes: list[NodeProcess] = []
        self._loaded: tuple[Instantiated, float] | None = None
        self._states: np.ndarray | None = None

    def __enter__(self) -> "BuildRun":
        with writing(self._folder):
            self._folder.mkdir()
        return self

    def __exit__(self, *exception: object) -> None:
        for process in self._processes:
            process.end()
        shutil.rmtree(self._folder, ignore_errors=True)

    @property
    def process(self) -> NodeProcess:
        return self._processes[0]

    def load(self) -> None:
        self._loaded = self._load(self._reference.files)

    def check(self) -> RoundingCheck:
        """Step the workload, and single steps along it; return how far the build is from C."""
        run, steps = self._reference.traced.run, self._reference.traced.steps
        self._states = self._run(self.process)
        single_steps = self._steps(steps.state, steps.control[:, None], hold=1)
        after = self._record(self.process, single_steps, [1], steps.state.shape)
        of_same_model = None
        if rounding_check.first_difference(self._states, run) is not None:
            self._load((str(self._reference.model_file),))
            of_same_model = self._run(self._processes[-1])
            self._processes.pop().end()
        return rounding_check.check(run, steps, self._states, after, of_same_model)

    def prepare(self) -> None:
        run, block = self._reference.traced.run, self._reference.block
        control = run.control[: block.nbatch, : block.nstep // run.hold]
        self.process.prepare(self._steps(run.states[0, : block.nbatch], control, run.hold))

    def check_blocks(self) -> None:
        """Refuse blocks that do not end where the run did that was checked."""
        assert self._states is not None, "the build was checked"
        file = self._folder / "block.f64"
        self.process.save(file)
        block = self._reference.block
        final = _read(file, (block.nbatch, self._states.shape[2]))
        if not np.array_equal(final, self._states[block.nstep, : block.nbatch]):
            detail = "timed blocks do not end where the run ended that was checked"
            raise NodeError(self.process.name, Failure(Status.DISAGREES, detail))

    def warm_up(self, least_s: float) -> StartUp:
        """Run blocks until they are steady, for some seconds at least; return what came before."""
        assert self._loaded is not None, "the build was loaded"
        instantiated, compile_ms = self._loaded
        blocks_ns, block = warm_up(self.process.time_block, least_s), self._reference.block
        return StartUp(
            instantiated.import_ms,
            instantiated.instantiate_ms,
            compile_ms,
            first_ns=blocks_ns[0] / (block.nbatch * block.nstep),
            warm_up_s=seconds_before_steady(blocks_ns),
            heap_bytes=instantiated.heap_bytes,
        )

    def _load(self, files: tuple[str, ...]) -> tuple[Instantiated, float]:
        build, engine = Build(self.variant.path), self._engine
        folder = self._folder / f"process{len(self._processes)}"
        with writing(folder):
            folder.mkdir()
        process = NodeProcess(engine.node, f"{build} ({self._model})", folder, engine.limit_s)
        self._processes.append(process)
        instantiated = process.instantiate(engine.package.script(build), engine.nthread)
        if instantiated.version != engine.package.version:
            raise MachineError(
                f"{engine.package.folder} says that it is {engine.package.version}, and its engine"
                f" that it is {instantiated.version}; install the package anew"
            )
        threads = self.variant.options.get(ENGINE_THREADS, 0)
        if threads and not instantiated.has_threadpool:
            raise UnavailableError(f"MuJoCo {instantiated.version} has no mju_threadpool")
        return instantiated, process.load(files, int(threads))

    def _run(self, process: NodeProcess) -> np.ndarray:
        """Return (nstep + 1, nbatch, nstate) states of the workload."""
        run = self._reference.traced.run
        steps = self._steps(run.states[0], run.control, run.hold)
        return self._record(process, steps, range(len(run.states)), run.states.shape)

    def _record(
        self, process: NodeProcess, steps: Steps, points: Sequence[int], shape: tuple[int, ...]
    ) -> np.ndarray:
        """Step in a process, and return the states after some numbers of steps, of a shape."""
        file = self._folder / "states.f64"
        process.record(steps, points, file)
        states = _read(file, shape)
        file.unlink()
        return states

    def _steps(self, starts: np.ndarray, control: np.ndarray, hold: int) -> Steps:
        files = {}
        for name, array in (("starts_file", starts), ("control_file", control)):
            file = self._folder / f"{name}.f64"
            with writing(file):
                file.write_bytes(np.ascontiguousarray(array, dtype=float).tobytes())
            files[name] = str(file)
        return {
            **files,
            "nbatch": len(starts),
            "ncontrol": control.shape[1],
            "hold": hold,
            "has_reset": self._reference.traced.run.has_reset,
        }


def warm_up(
    time_block: Callable[[], int], least_s: float, clock: Callable[[], float] = time.perf_counter
) -> list[int]:
    """Run blocks until they get no faster, or for ten seconds; return their nanoseconds.

    V8 compiles WebAssembly quickly first, and functions that run often again, meanwhile.
    """
    begin, blocks = clock(), [time_block()]
    while True:
        spent_s = clock() - begin
        enough = len(blocks) >= 2 * _WINDOW and spent_s >= least_s
        if (enough and _is_steady(blocks)) or spent_s >= _MAX_S:
            return blocks
        blocks.append(time_block())


def seconds_before_steady(blocks_ns: Sequence[int]) -> float:
    steady_ns = _NEARLY_STEADY * statistics.median(blocks_ns[-_WINDOW:])
    return sum(itertools.takewhile(lambda ns: ns > steady_ns, blocks_ns)) / 1e9


def _is_steady(blocks: list[int]) -> bool:
    last, before = blocks[-_WINDOW:], blocks[-2 * _WINDOW : -_WINDOW]
    return statistics.median(last) >= _STEADY * statistics.median(before)


def _read(file: Path, shape: tuple[int, ...]) -> np.ndarray:
    try:
        values = np.fromfile(file)
    except OSError as error:
        raise MachineError(f"cannot read {file}: {error.strerror}") from error
    if values.size != np.prod(shape):
        raise MachineError(f"{file} has {values.size} numbers instead of {np.prod(shape)}")
    return values.reshape(shape)
