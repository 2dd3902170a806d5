"""The asv benchmark classes as pytest-benchmark cases.

`pytest --benchmark-only` times them with the installed MuJoCo; a plain `pytest` runs each once,
untimed, over the models whose step is short.
"""

import functools
import importlib
import importlib.util
import inspect
import itertools
import json
import math
import os
import pkgutil
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from typing import Any

import mujoco
import pytest
from commands import ROOT
from index_access import index_has_mujoco

import benchmarks
from benchmarks import instructions, mjx, reference, stored
from benchmarks.settings import Cached
from mjbench import paths
from mjbench.counts import counted_program
from mjbench.counts.counted_program import CountedWork, ModelRequest
from mjbench.counts.instructions import ModelCount
from mjbench.errors import MachineError
from mjbench.host import isolate
from mjbench.paired.moved_check import PlacementControl
from mjbench.releases import installs, release_names
from mjbench.simulation import models
from mjbench.status import Status

PREFIXES = ("time_", "timeraw_", "track_", "peakmem_")
# Models that are counted, and compared with the reference release: with contacts and without.
FEW_MODELS = ("cartpole", "cube_table")
# Units of what may be 0: counts of a model without contact, and a drift of nothing. A ratio, a time
# or a number of instructions that is 0 was never measured.
ZERO_IS_POSSIBLE = {"contacts/step", "constraints/step", "iterations/step", "SI"}

# Seconds of all rounds of a timed benchmark, about, and the fewest and the most rounds.
SECONDS, LEAST_ROUNDS, MOST_ROUNDS = 0.1, 4, 20
# Parameters that decide what is done, and not how.
WORK = ("model", "samples")


@dataclass(frozen=True)
class Case:
    """One benchmark method with one set of parameters."""

    kind: Any
    method: str
    params: tuple[Any, ...]

    def __str__(self) -> str:
        values = "-".join(map(str, self.params))
        return f"{self.kind.__name__}.{self.method}" + (f"[{values}]" if values else "")

    @property
    def name(self) -> str:
        """What asv calls the benchmark."""
        module = self.kind.__module__.removeprefix("benchmarks.")
        return f"{module}.{self.kind.__name__}.{self.method}"

    @property
    def function(self) -> Any:
        """The method as it is declared, with its unit and its names."""
        return getattr(self.kind, self.method)

    @property
    def model(self) -> str:
        names = getattr(self.kind, "param_names", ())
        return str(self.params[names.index("model")]) if "model" in names else "no model"

    @property
    def settings(self) -> dict[str, Any]:
        """The parameters by name beside those of WORK; cases of one group differ in them."""
        return {k: v for k, v in self._named_params.items() if k not in WORK}

    @property
    def group(self) -> str:
        """What it is compared within: the same benchmark, of the same work if it has settings."""
        work = [str(v) for k, v in self._named_params.items() if k in WORK]
        name = str(self.function.pretty_name).partition(" (ms read")[0]
        return ": ".join([name, *work]) if self.settings else name

    @property
    def variant(self) -> str:
        """Which of its group it is."""
        values = [v if isinstance(v, str) else f"{k}={v}" for k, v in self.settings.items()]
        return ", ".join(values) or self._named_params.get("model", "")

    @property
    def things(self) -> tuple[int, str]:
        """How many things a call does, and what they are, such as (1000, "step")."""
        named = re.match(r"time_(\d+)_([a-z]+)", self.method)
        if named is None:
            return 1, "call"
        thing = re.sub("ies$", "y", named[2]).removesuffix("s")
        return int(named[1]), thing.replace("mjdata", "MjData")

    @property
    def _named_params(self) -> dict[str, Any]:
        return dict(zip(getattr(self.kind, "param_names", ()), self.params, strict=True))

    @property
    def is_heavy(self) -> bool:
        """Whether it takes long, and another case shows as well that the benchmark works."""
        if self.kind in (instructions.Instructions, reference.Reference):
            return self.model not in FEW_MODELS
        return self.model in stored.HEAVY

    @property
    def has_tools(self) -> bool:
        """Whether what the benchmark needs beside MuJoCo is installed."""
        if self.name.startswith("mjx."):
            return all(map(importlib.util.find_spec, ("jax", "mujoco.mjx")))
        return True

    def bound(self) -> Any:
        """Return the method after `setup`; skip a benchmark that need not apply here.

        On the release that stored the states every benchmark applies, if its tools are installed.
        """
        instance = self.kind()
        first = [_cached(self.kind)] if hasattr(self.kind, "setup_cache") else []
        try:
            getattr(instance, "setup", lambda *params: None)(*first, *self.params)
        except NotImplementedError as reason:
            if stored.stored_release() == mujoco.__version__ and self.has_tools:
                raise
            pytest.skip(str(reason))
        return functools.partial(getattr(instance, self.method), *first)


@functools.cache
def _cached(kind: Any) -> Any:
    """Return what asv would pass to every benchmark of a class."""
    return kind().setup_cache()


def classes() -> Iterator[type]:
    for info in pkgutil.iter_modules(benchmarks.__path__):
        module = importlib.import_module(f"benchmarks.{info.name}")
        for name, kind in inspect.getmembers(module, inspect.isclass):
            if kind.__module__ == module.__name__ and not name.startswith("_"):
                yield kind


def cases(*prefixes: str) -> Iterator[Case]:
    for kind in classes():
        axes = getattr(kind, "params", [])
        axes = axes if axes and isinstance(axes[0], list | tuple) else [axes] if axes else []
        for method in vars(kind):
            if method.startswith(prefixes):
                for params in itertools.product(*axes):
                    yield Case(kind, method, params)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    is_timing = metafunc.config.getoption("benchmark_only")
    for fixture, prefixes in (("timed", ("time_", "timeraw_")), ("exact", ("track_", "peakmem_"))):
        if fixture in metafunc.fixturenames:
            selected = [c for c in cases(*prefixes) if is_timing or not c.is_heavy]
            assert selected, f"no benchmark begins with {prefixes}"
            metafunc.parametrize(fixture, selected, ids=str)


@pytest.fixture(scope="session")
def reference_release() -> None:
    """Install the reference release; skip only where that fails because pip reaches no index."""
    try:
        with installs.use(release_names.parse_release(reference.REFERENCE)):
            pass
    except MachineError as error:
        if index_has_mujoco():
            raise
        pytest.skip(f"the package index cannot be reached: {error}")


def test_time(timed: Case, benchmark: Any) -> None:
    method = timed.bound()
    is_raw = timed.method.startswith("timeraw_")
    run = functools.partial(_interpret, method()) if is_raw else method
    benchmark.group = timed.group
    count, per = timed.things
    benchmark.extra_info.update(
        variant=timed.variant, count=count, per=per, is_comparable=bool(timed.settings)
    )
    params = () if is_raw else timed.params
    rounds = _rounds(functools.partial(run, *params)) if benchmark.enabled else 1
    assert benchmark.pedantic(run, args=params, rounds=rounds) is None


def _rounds(run: Callable[[], object]) -> int:
    """Return how many rounds fit the time of a benchmark; a call of it warms up."""
    begin_s = time.perf_counter()
    run()
    fitting = SECONDS / (time.perf_counter() - begin_s)
    return round(min(max(fitting, LEAST_ROUNDS), MOST_ROUNDS))


def _interpret(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True)


def call_or_compile_nothing(
    call: Callable[..., Any], function: Callable[..., Any], *arguments: Any, **options: Any
) -> Any:
    """Stand in for children that compile the path `mjx`.

    tests/benchmarks/test_mjx.py tests what they time, and
    tests/commands/compare/test_accelerated_measurement.py compiles the path.
    """
    if function is mjx.compare_with_handwritten:  # this one still compiles the program by hand
        assert arguments[0].name == "mjx"
        return call(function, paths.find(paths.BASE), *arguments[1:], **options)
    if function is not mjx.compile_and_time:
        return call(function, *arguments, **options)
    path, model, nbatch, nstep = arguments
    workload = stored.stored_workload(model, nbatch, nstep)
    assert (path.name, workload.nbatch, workload.nstep) == ("mjx", nbatch, nstep)
    return Cached(Status.OK, value=mjx.MjxTimes(compile_s=2.0, block_s=[0.5]))


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Have no instruction counted; return the models of each process, which does its work here."""
    processes: list[list[str]] = []

    def count(
        release: release_names.ReleaseSpec, requests: Sequence[ModelRequest], limit_s: float
    ) -> Iterator[ModelCount]:
        names = [request.source.name for request in requests]
        processes.append(names)
        ours, theirs = Pipe()
        with ours, theirs:
            ours.send((release.version, requests))
            counted_program.main(os.dup(theirs.fileno()))
            for name in names:
                assert isinstance(ours.recv(), CountedWork)
                yield ModelCount(model=name, release=release.version, instructions_per_step=9.0)

    monkeypatch.setattr("mjbench.counts.instructions._count", count)
    monkeypatch.setattr("mjbench.counts.instructions.unavailable", lambda: None)
    monkeypatch.setattr("benchmarks.instructions.stored.nstep_of", lambda name: stored.HEAVY_NSTEP)
    return processes


def test_what_is_tracked_is_a_number_that_was_measured(
    exact: Case,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
    processes: list[list[str]],
    without_warp: None,
) -> None:
    if exact.kind is reference.Reference:
        request.getfixturevalue("reference_release")
    # any number will do, not a precise one
    monkeypatch.setattr(isolate, "call", functools.partial(call_or_compile_nothing, isolate.call))
    monkeypatch.setattr("benchmarks.reference.LAUNCHES", 2)
    for kind in (instructions.Instructions, reference.Reference):
        monkeypatch.setattr(kind, "params", [*FEW_MODELS])
    monkeypatch.setattr("benchmarks.mjx.NBATCH", 2)
    monkeypatch.setattr("benchmarks.mjx.NSTEP", 2)
    for module in ("mjx", "record"):
        monkeypatch.setattr(f"benchmarks.{module}.ROUNDS", 3)
    as_shipped = PlacementControl(False)
    monkeypatch.setattr(
        "mjbench.paired.moved_check.placement_control", lambda *arguments: as_shipped
    )
    if exact.kind is mjx.Mjx:
        exact = replace(exact, params=("cartpole", 1))
        monkeypatch.setattr(mjx.Mjx, "params", (["cartpole"], [1]))
    value = exact.bound()(*exact.params)
    if exact.method.startswith("peakmem_"):
        assert value is None  # asv reads the memory of the process
        return
    assert math.isfinite(value)
    assert value > 0 or (value == 0 and exact.function.unit in ZERO_IS_POSSIBLE)


def test_every_model_is_counted_in_one_of_two_processes(processes: list[list[str]]) -> None:
    cache = instructions.Instructions().setup_cache()
    assert {cache[name].get() for name in models.shipped()} == {9.0}
    assert sorted(itertools.chain(*processes)) == sorted(models.shipped())
    assert len(processes) == 2


def test_times_are_of_one_thing_and_grouped_by_what_is_compared() -> None:
    things = {case.method: case.things for case in cases("time_")}
    assert things["time_1000_steps"] == (1000, "step")
    assert things["time_3200_steps_by_rollout"] == (3200, "step")
    assert things["time_20_copies"] == (20, "copy")
    rollouts = [case for case in cases("time_") if case.kind.__name__ == "RolloutThreads"]
    assert {case.group for case in rollouts if case.model == "humanoid"} == {
        "rollout of 64 × 50 steps, by threads: humanoid"
    }
    assert {case.variant for case in rollouts} >= {"threads=1", "threads=2"}


def test_no_module_declares_a_benchmark_of_another() -> None:
    """asv would measure it twice: it takes every class that it finds in a module."""
    for info in pkgutil.iter_modules(benchmarks.__path__):
        module = importlib.import_module(f"benchmarks.{info.name}")
        for name, kind in inspect.getmembers(module, inspect.isclass):
            methods = [each for each in dir(kind) if each.startswith(PREFIXES)]
            is_benchmark = any(inspect.isfunction(getattr(kind, each)) for each in methods)
            assert not is_benchmark or kind.__module__ == module.__name__, f"{info.name}.{name}"


def test_every_benchmark_has_an_explicit_version_a_name_for_readers_and_its_unit() -> None:
    for case in cases(*PREFIXES):
        assert case.kind.version, case
        assert case.function.pretty_name, case
        assert not case.method.startswith("track_") or case.function.unit, case


def test_committed_results_are_of_benchmarks_that_exist() -> None:
    """asv knows a result by the benchmark's name, version, parameters and unit."""
    committed = json.loads((ROOT / "results/asv/benchmarks.json").read_text())
    committed.pop("version")
    declared = {case.name: case for case in cases(*PREFIXES)}
    assert set(committed) <= set(declared)
    assert len(committed) > 20
    for name, stored_as in committed.items():
        case = declared[name]
        assert stored_as["pretty_name"] == case.function.pretty_name, name
        assert stored_as["unit"] == getattr(case.function, "unit", stored_as["unit"]), name
        assert stored_as["param_names"] == list(getattr(case.kind, "param_names", ())), name


def test_every_timed_benchmark_gives_the_20_samples_that_asv_needs() -> None:
    for case in cases("time_", "timeraw_"):
        assert case.kind.repeat * case.kind.rounds >= 20, case


@pytest.mark.parametrize("name", models.shipped())
def test_stored_states_are_of_the_model_as_it_is(name: str) -> None:
    assert stored.stored_digest(name) == stored.mjcf_digest(name), (
        f"{name}.xml was changed: python -m benchmarks.stored, and raise the versions"
    )


@pytest.mark.parametrize("name", [n for n in models.shipped() if n not in stored.HEAVY])
def test_the_release_that_stored_the_states_does_not_drift(name: str) -> None:
    if stored.stored_release() != mujoco.__version__:
        pytest.skip("the states were stored by another release")
    assert stored.drift(name) <= 1e-12


def test_models_that_need_a_later_release_are_those_of_the_table() -> None:
    table = (models.shipped_folder() / "README.md").read_text()
    since = dict(re.findall(r"^\| `(\w+)` .*\| ([\d.]+) \|$", table, flags=re.MULTILINE))
    first = "2.3.7"
    assert {name: v for name, v in since.items() if v != first} == stored.SINCE


def test_a_model_that_the_release_cannot_load_is_not_applicable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("mujoco.__version__", "2.3.7")
    with pytest.raises(NotImplementedError, match=r"cloth needs MuJoCo 3\.0\.0"):
        stored.load("cloth")


def test_a_path_that_computes_something_else_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    from wrong_paths import ColdWarmStart

    stored.prepared_run.cache_clear()
    monkeypatch.setattr("mjbench.paths.find", lambda name: ColdWarmStart())
    with pytest.raises(RuntimeError, match="disagrees with the plain loop"):
        stored.prepared_run("python_loop", "cube_table")
    stored.prepared_run.cache_clear()
