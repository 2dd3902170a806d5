"""What the tests share: a small model that starts in contact, and its workload."""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import benchmark_tables
import inline_tasks
import mujoco
import pytest
from benchmark_tables import BenchmarkTime
from commands import TESTS
from example_models import CONTACT_XML
from headless_browser import session
from hypothesis import settings

from mjbench.host import isolate, neighbours
from mjbench.host.machine import ProcessorTime
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results import terminal
from mjbench.simulation import workload
from mjbench.verification import step_costs

# The same examples in every run: a test that passed does not fail by chance.
settings.register_profile("mjbench", derandomize=True, deadline=None)
settings.load_profile("mjbench")


# With --benchmark-only, no other file is collected.
BENCHMARKS = TESTS / "benchmarks/test_classes.py"
# Modules with the longest tests, which run first: none of them is left for one worker at the end.
SLOWEST = (
    "benchmarks/test_discovery.py",
    "benchmarks/studies/test_same_behaviour.py",
    "commands/compare/test_accelerated_measurement.py",
    "commands/tune/test_reference.py",
    "counts/test_instructions.py",
    "paths/test_accelerated.py",
    "results/test_hostile_text.py",
)


def pytest_configure(config: pytest.Config) -> None:
    """Time nothing unless asked to, and take signals; `pytest` runs every benchmark once."""
    os.environ.pop("COLUMNS", None)  # pytest-xdist sets it; tests that need a width set it
    if not (config.getoption("benchmark_only") or config.getoption("benchmark_enable")):
        config.option.benchmark_disable = True
    if config.getoption("benchmark_only"):
        config.option.benchmark_quiet = True  # see pytest_terminal_summary
    _take_signals()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files without benchmarks where only benchmarks run and no file is named."""
    is_named = config.args_source == pytest.Config.ArgsSource.ARGS
    if is_named or not config.getoption("benchmark_only") or collection_path.is_dir():
        return None
    return collection_path != BENCHMARKS or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what times nothing where only benchmarks run; begin with the longest tests."""
    if config.getoption("benchmark_only"):
        items[:] = [item for item in items if "benchmark" in getattr(item, "fixturenames", ())]
    slowest = {TESTS / name for name in SLOWEST}
    items.sort(key=lambda item: item.path not in slowest)


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the times of benchmarks, grouped by what is compared."""
    session = getattr(config, "_benchmarksession", None)
    if session is None or not config.getoption("benchmark_only"):
        return
    times = [time for each in session.benchmarks for time in _times(each)]
    out = terminal.console()
    for table, line in benchmark_tables.groups(times):
        terminalreporter.ensure_newline()
        out.print(f"\n{table.title}", style="bold", soft_wrap=True)
        for part in terminal.table_parts(table, benchmark_tables.WIDTH):
            out.print(part, soft_wrap=True)
        out.print(line, soft_wrap=True)
    if times:
        out.print(f"\n{benchmark_tables.CAUTION}", width=benchmark_tables.WIDTH)


def _times(benchmark: Any) -> Iterator[BenchmarkTime]:
    """Yield the time of one thing that a benchmark does; none where it was not timed."""
    extra, stats = benchmark.extra_info, benchmark.stats
    if not stats.data or "variant" not in extra:
        return
    median_ns, low_ns, high_ns = (
        1e9 * seconds / extra["count"] for seconds in (stats.median, stats.q1, stats.q3)
    )
    yield BenchmarkTime(
        benchmark.group,
        extra["variant"],
        extra["per"],
        median_ns,
        low_ns,
        high_ns,
        stats.rounds,
        extra["is_comparable"],
    )


def _take_signals() -> None:
    """Have signals end this process, which a background job ignores and a command handles."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(autouse=True)
def _hook_of_dropped_exceptions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Restore what a command sets when its signals are handled."""
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)


@pytest.fixture
def quiet_host(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take no processor time from the runs: that would be a record of theirs, too."""
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda *_: 0.0)


@pytest.fixture(scope="session", autouse=True)
def _no_traces(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Take no notice of other mjbench on this machine; keep out of the user's tables."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(neighbours.IGNORE_VARIABLE, "1")
        costs = tmp_path_factory.mktemp("step_costs") / "costs.json"
        patch.setenv(step_costs.FILE_VARIABLE, str(costs))
        # a thread of OpenBLAS, which waits busily, costs more than it saves in a short process
        patch.setenv("OPENBLAS_NUM_THREADS", "1")
        # what XLA saves by optimising a program is less than what that takes; its emitters of
        # fusions take half of the time of a compilation
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        patch.setenv("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
        yield


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    yield from session()


@pytest.fixture(scope="session")
def model() -> Any:
    return mujoco.MjModel.from_xml_string(CONTACT_XML)


@pytest.fixture
def small(model: Any) -> workload.Workload:
    return workload.make(model, nbatch=5, nstep=12, hold=3, seed=1)


@pytest.fixture
def without_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide Warp from child processes of MJX, which would take seconds to import it."""
    folders = (str(TESTS / "without_warp"), os.environ.get("PYTHONPATH", ""))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, folders)))


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do in this process what `isolate` would do in a child."""
    monkeypatch.setattr(isolate, "run", inline_tasks.run)


@pytest.fixture(scope="session")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(limit_s=30.0) as pool:
        yield pool


@pytest.fixture
def contact_file(tmp_path: Any) -> str:
    path = tmp_path / "contact.xml"
    path.write_text(CONTACT_XML)
    return str(path)


def pytest_runtest_teardown() -> None:
    """Undo what usually ends with its process: disabled garbage collection, handlers of signals."""
    gc.enable()
    _take_signals()
