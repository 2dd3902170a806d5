"""A function of a revision of the user's code, in the process that times it.

This module runs in the environment of any revision: it needs the standard library, NumPy and
MuJoCo.
"""

import functools
import importlib
import inspect
import os
import sys
import time
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, UnavailableError, describe
from mjbench.formats import listed
from mjbench.measuring import calls
from mjbench.measuring.calls import Compilation
from mjbench.measuring.timing import LEAST_S
from mjbench.paired import memory_blocks
from mjbench.paired.call_results import Leaf, leaves
from mjbench.paired.loop_sections import LoopSection
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.worker import Worker, activity

# How many results are compared: a function may keep state from call to call.
RESULTS = 3
# The parameter by which a test asks for the fixture of pytest-benchmark.
_FIXTURE = "benchmark"
# Packages that this process imports for itself, from its own environment.
MEASURING = frozenset({"glfw", "mjbench", "mujoco", "numpy"})
# The set-up of a module or of a class, which asv calls so, too.
_SETUP = "setup"


@dataclass(frozen=True)
class FunctionSource:
    """Where a process finds a function.

    Attributes:
      name: of the function, or of a class and its method: `Class.method`.
      file: that the module stands for.
      text: of that file, which may be another revision's.
      folders: to import from, before all others if `are_first`, else after them.
    """

    name: str
    module: str
    file: str
    text: bytes
    folders: tuple[str, ...] = ()
    are_first: bool = True
    cwd: str = ""


@dataclass(frozen=True)
class CodeOrigin:
    """Where code of the user's package must come from.

    Attributes:
      checkout: no module may come from there, unless it lies in one of `folders` or in the
        environment of the process.
    """

    packages: frozenset[str]
    folders: tuple[str, ...]
    checkout: str


@dataclass(frozen=True, eq=False)
class FunctionFacts:
    """What a process found out about a function.

    Attributes:
      results: of the first calls; empty where they cannot be compared.
      problem: why they cannot; empty otherwise.
      calls: that last as long as a block.
      cores: that a call kept busy, on average.
      misplaced: a module that is not the revision's, and its file; empty without one.
      versions: of what is the same on both sides of a fair comparison, by name.
      compilation: of what it runs; None where nothing is compiled first.
    """

    results: Sequence[Sequence[Leaf]]
    problem: str
    calls: int
    call_s: float
    cores: float
    misplaced: str
    versions: Mapping[str, str]
    compilation: Compilation | None = None


class _Recorder:
    """Stands for the fixture of pytest-benchmark: it notes what a test has it time."""

    def __init__(self) -> None:
        self.function: calls.Function | None = None

    def __call__(self, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        self.function = functools.partial(function, *arguments, **named)
        return self.function()

    def pedantic(
        self,
        target: Callable[..., Any],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
        setup: object = None,
        **_: object,
    ) -> Any:
        """Do the same; raises InputError for a set-up, which would run before each call."""
        if setup is not None:
            raise InputError("benchmark.pedantic with a setup cannot be timed in blocks")
        return self(target, *args, **(kwargs or {}))


class TimedFunction:
    """A function that was imported; UnavailableError where there is none, or its import fails."""

    def __init__(self, source: FunctionSource):
        self._name = source.name
        if source.are_first:
            sys.path[:0] = source.folders
        else:
            sys.path += source.folders
        if source.cwd:
            os.chdir(source.cwd)
        try:
            self._module = _imported(source)
        except BaseException as error:  # a module may raise SystemExit
            raise UnavailableError(f"cannot import {source.module}: {describe(error)}") from error
        self._owner: Any = self._module
        *owners, last = source.name.split(".")
        for name in (*owners, last):
            if not hasattr(self._owner, name):
                raise UnavailableError(f"{source.module} has no {source.name}{self._others()}")
            if name != last:
                self._owner = getattr(self._owner, name)

    def _others(self) -> str:
        """Return which functions the module has, as the end of a sentence."""
        named = vars(self._module).items()
        own = [name for name, each in named if inspect.isfunction(each) and name[0] != "_"]
        return f", but it has {listed(own)}" if own else ""

    def fresh(self) -> calls.Function:
        """Set up anew; return what is to be called. InputError where it takes arguments."""
        owner = self._owner
        if setup := getattr(self._module, _SETUP, None):
            setup()
        if isinstance(owner, type):
            owner = owner()
            if setup := getattr(owner, _SETUP, None):
                setup()
        function: Callable[..., Any] = getattr(owner, self._name.rpartition(".")[2])
        if inspect.iscoroutinefunction(function) or inspect.isgeneratorfunction(function):
            raise InputError(f"{self._name} does nothing when it is called: await or consume it")
        required = _required(function)
        if required == [_FIXTURE]:
            recorder = _Recorder()
            function(benchmark=recorder)
            if recorder.function is None:
                raise InputError(f"{self._name} does not call benchmark")
            return recorder.function
        if required:
            raise InputError(
                f"{self._name} takes {', '.join(required)}: a benchmark takes no arguments, or"
                f" {_FIXTURE} of pytest-benchmark alone"
            )
        return function


def _imported(source: FunctionSource) -> types.ModuleType:
    """Run a text as the file that it stands for."""
    parent = source.module.rpartition(".")[0]
    if parent:
        importlib.import_module(parent)
    module = types.ModuleType(source.module)
    module.__file__, module.__package__ = source.file, parent
    sys.modules[source.module] = module
    exec(compile(source.text, source.file, "exec"), module.__dict__)
    return module


def _required(function: Callable[..., Any]) -> list[str]:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # of an extension module, it may say nothing
        return []
    optional = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return [p.name for p in parameters if p.default is p.empty and p.kind not in optional]


def _finish(result: object) -> None:
    """Wait for what a call only began: JAX returns before it has computed."""
    jax = sys.modules.get("jax")
    if jax is not None and result is not None:
        jax.block_until_ready(result)


def _block(function: calls.Function, count: int) -> None:
    calls.repeat(function, count - 1)
    _finish(function())


def misplaced(
    modules: Mapping[str, Sequence[str]], origin: CodeOrigin, environment: Collection[str]
) -> str:
    """Return a module that is not the revision's, and its file; empty without one."""
    for name, files in modules.items():
        package = name.partition(".")[0]
        is_own = package in origin.packages
        if package in MEASURING and not is_own:
            continue
        for file in files:
            if _lies_in(file, origin.folders):
                continue
            is_elsewhere = _lies_in(file, [origin.checkout]) and not _lies_in(file, environment)
            if is_own or is_elsewhere:
                return f"{name} from {file}"
    return ""


def _lies_in(file: str, folders: Collection[str]) -> bool:
    return any(Path(file).is_relative_to(folder) for folder in folders)


def _module_files() -> dict[str, list[str]]:
    """Return the file of each imported module, or its first folder, links followed."""
    files: dict[str, list[str]] = {}
    for name, module in list(sys.modules.items()):
        try:
            own = getattr(module, "__file__", None)
            # of a package without a file, what is imported lies in the first folder that has it
            places = [own] if own else list(getattr(module, "__path__", ()))[:1]
            files[name] = [os.path.realpath(place) for place in places]
        except Exception:  # some modules are objects that answer for anything
            continue
    return files


def _versions() -> dict[str, str]:
    versions = {"Python": sys.version}
    for name in ("mujoco", "numpy", "jax", "jaxlib"):
        if (module := sys.modules.get(name)) is not None:
            versions[name] = str(getattr(module, "__version__", ""))
    return versions


# -- tasks of a worker --------------------------------------------------------------------------


@activity("importing the benchmark")
def import_function(worker: Worker, source: FunctionSource, calls_it: bool = False) -> None:
    """Import a function; call it, too, where what it does only once is to be done."""
    function = TimedFunction(source)
    worker.extend(function)
    if calls_it:
        _finish(function.fresh()())


@activity("calling the benchmark")
def try_function(worker: Worker, origin: CodeOrigin) -> FunctionFacts:
    """Call a function a few times, and return what is to be known before it is timed."""
    imported = worker.extension(TimedFunction)
    try:
        function, count = imported.fresh(), 1
        if isinstance(function, calls.PreparedCall):  # once, because it keeps no state
            function.prepare()
            call_s, cores = _timed(function.timed, count)
            results, problem = _results(function.result, count)
        else:
            results, problem = _results(function, RESULTS)
            function = imported.fresh()
            count = calls.calls_per_block(functools.partial(_seconds, function))
            call_s, cores = _timed(function, count)
    except (InputError, MachineError):
        raise
    except BaseException as error:  # it may raise SystemExit
        raise UnavailableError(f"it raises {describe(error)}") from error
    environment = {os.path.realpath(folder) for folder in (sys.prefix, sys.base_prefix)}
    return FunctionFacts(
        results,
        problem,
        count,
        call_s,
        cores,
        misplaced(_module_files(), origin, environment),
        _versions(),
        _compilation(function),
    )


def _compilation(function: calls.Function) -> Compilation | None:
    if isinstance(function, calls.PreparedCall) and function.compilation is not None:
        return function.compilation()
    return None


def _results(function: calls.Function, count: int) -> tuple[list[list[Leaf]], str]:
    results = []
    for _ in range(count):
        result = function()
        try:
            results.append(leaves(result))
        except Exception as error:  # a type of the user's own may raise anything
            return [], describe(error)
    return results, ""


def _timed(function: calls.Function, count: int) -> tuple[float, float]:
    begin_s, busy_s = time.perf_counter(), time.process_time()
    _block(function, count)
    all_s = max(LEAST_S, time.perf_counter() - begin_s)
    return all_s / count, (time.process_time() - busy_s) / all_s


def _seconds(function: calls.Function, count: int) -> float:
    begin_s = time.perf_counter()
    _block(function, count)
    return time.perf_counter() - begin_s


def _called_once(function: calls.PreparedCall) -> LoopSection:
    """Return a block that gives the nanoseconds that count of one call, which is done here."""
    function()
    compilation = _compilation(function)
    assert compilation is not None, "of paths that compile"
    ns = round(1e9 * compilation.seconds)
    return LoopSection(calls.nothing, reading=lambda: ns)


@activity("asking for times of compiling")
def compilation_of(worker: Worker) -> Compilation | None:
    return _compilation(worker.extension(TimedFunction).fresh())


@activity("preparing the benchmark")
def prepare_function(
    worker: Worker, cores: Sequence[int], count: int, metric: Metric = Metric.TIME
) -> int:
    """Set a function up in fresh memory; return the nanoseconds of a block, warm-ups included.

    Every call keeps in step with those of the other side, so a function that keeps state is timed
    in the same states there.
    """
    imported = worker.extension(TimedFunction)

    def section() -> LoopSection:
        function = imported.fresh()
        if METRICS[metric].is_of_memory:
            block = functools.partial(_block, function, count)
            return memory_blocks.peak_section(block)
        if isinstance(function, calls.PreparedCall):
            if METRICS[metric].compiles:
                return _called_once(function)
            check = functools.partial(calls.repeat, function.result, 1)
            return LoopSection(function.timed, function.prepare, check)
        warm_up = function if count > 1 else calls.nothing  # caches hold what the other side did
        return LoopSection(
            functools.partial(_block, function, count), functools.partial(calls.repeat, warm_up, 1)
        )

    return worker.prepare_section(cores, section)
