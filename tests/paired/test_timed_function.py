"""Functions of the user's code in the process that times them; here it is this process."""

import gc
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import cast

import pytest

from mjbench.errors import InputError, MachineError, UnavailableError
from mjbench.measuring.calls import Compilation
from mjbench.paired import timed_function
from mjbench.paired.metrics import Metric
from mjbench.paired.timed_function import CodeOrigin, FunctionSource, TimedFunction
from mjbench.paired.worker import Worker

Imported = Callable[..., TimedFunction]


@pytest.fixture
def imported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Imported:
    """Return what imports a function of a text; what it does to this process is undone."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def from_text(text: str, name: str = "step", **fields: str) -> TimedFunction:
        file = str(tmp_path / "bench.py")
        source = FunctionSource(
            name, "own_bench", file, text.encode(), (str(tmp_path),), cwd=str(tmp_path)
        )
        return TimedFunction(source)

    return from_text


def test_a_text_runs_as_the_file_that_it_stands_for(imported: Imported, tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text("VALUE = 7\n")
    function = imported("import beside\ndef step(): return __file__, beside.VALUE\n").fresh()
    assert function() == (str(tmp_path / "bench.py"), 7)


def test_the_set_up_of_the_module_runs_first(imported: Imported) -> None:
    text = "calls = []\ndef setup(): calls.append('setup')\ndef step(): return list(calls)\n"
    function = imported(text)
    assert function.fresh()() == ["setup"]
    assert function.fresh()() == ["setup", "setup"]


def test_each_layout_has_an_instance_of_a_class_of_its_own(imported: Imported) -> None:
    text = """
class TimeStep:
    def setup(self): self.count = 0
    def time_step(self):
        self.count += 1
        return self.count
"""
    function = imported(text, "TimeStep.time_step")
    first = function.fresh()
    assert (first(), first()) == (1, 2)
    assert function.fresh()() == 1


@pytest.mark.parametrize(
    "call", ["benchmark(add, 1, b=2)", "benchmark.pedantic(add, args=(1,), kwargs={'b': 2})"]
)
def test_a_test_of_pytest_benchmark_is_timed_by_what_it_asks_for(
    imported: Imported, call: str
) -> None:
    text = f"def add(a, b): return a + b\ndef test_add(benchmark): assert {call} == 3\n"
    assert imported(text, "test_add").fresh()() == 3


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("def step(model): pass\n", "step", "step takes model: a benchmark takes no arguments"),
        ("def step(benchmark): pass\n", "step", "step does not call benchmark"),
        ("def step(): yield 1\n", "step", "step does nothing when it is called"),
        ("async def step(): pass\n", "step", "step does nothing when it is called"),
        (
            "def step(benchmark): benchmark.pedantic(print, setup=print)\n",
            "step",
            "with a setup cannot be timed",
        ),
    ],
)
def test_what_cannot_be_called_alone_is_refused(
    imported: Imported, text: str, name: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        imported(text, name).fresh()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def other(): pass\n", "own_bench has no step"),
        ("import nowhere_to_be_found\n", "cannot import own_bench: ModuleNotFoundError"),
        ("raise SystemExit(3)\n", "cannot import own_bench: SystemExit: 3"),
        ("def step(:\n", "cannot import own_bench: SyntaxError"),
    ],
)
def test_what_a_revision_lacks_is_reported(imported: Imported, text: str, message: str) -> None:
    with pytest.raises(UnavailableError, match=message):
        imported(text)


PREPARED = """
from mjbench.errors import MachineError
from mjbench.measuring.calls import PreparedCall
log = []
def result():
    log.append("result")
    return 7
step = PreparedCall(lambda: log.append("prepare"), lambda: log.append("timed"), result)
def overflow(): raise MachineError("a buffer overflowed")
wrong = PreparedCall(print, print, overflow)
"""


def test_what_prepares_a_call_is_not_timed(imported: Imported) -> None:
    worker = Worker(cast(Connection, None))
    worker.extend(imported(PREPARED))
    facts = timed_function.try_function(worker, ORIGIN)
    log = sys.modules["own_bench"].log
    assert (facts.calls, len(facts.results), facts.compilation) == (1, 1, None)
    assert log == ["prepare", "timed", "result"]
    log.clear()
    try:
        timed_function.prepare_function(worker, (), facts.calls)
    finally:
        gc.unfreeze()
        gc.enable()
    (section,) = worker.sections
    assert log == ["prepare", "timed", "result"]
    log.clear()
    section.run()
    assert log == ["timed"]


COMPILING = f"""{PREPARED}
from mjbench.measuring.calls import Compilation
took = Compilation(trace_s=0.5, compile_s=1.0, first_run_s=0.2)
step = PreparedCall(step.prepare, step.timed, result, lambda: took)
"""


def test_what_compiles_is_called_once_and_blocks_only_give_its_time(imported: Imported) -> None:
    worker = Worker(cast(Connection, None))
    worker.extend(imported(COMPILING))
    try:
        timed_function.prepare_function(worker, (), 1, Metric.COMPILE)
    finally:
        gc.unfreeze()
        gc.enable()
    (section,) = worker.sections
    assert sys.modules["own_bench"].log == ["prepare", "timed", "result"]
    section.run()
    section.run()
    assert section.reading() == 1_500_000_000
    took = Compilation(trace_s=0.5, compile_s=1.0, first_run_s=0.2)
    assert timed_function.compilation_of(worker) == took
    assert sys.modules["own_bench"].log == ["prepare", "timed", "result"]


def test_a_wrong_result_is_a_failure_not_something_that_one_side_cannot_do(
    imported: Imported,
) -> None:
    worker = Worker(cast(Connection, None))
    worker.extend(imported(PREPARED, "wrong"))
    with pytest.raises(MachineError, match="a buffer overflowed"):
        timed_function.try_function(worker, ORIGIN)
    try:
        with pytest.raises(MachineError, match="a buffer overflowed"):
            timed_function.prepare_function(worker, (), 1)
    finally:
        gc.unfreeze()
        gc.enable()


ORIGIN = CodeOrigin(frozenset({"own"}), ("/cache/a",), "/checkout")


@pytest.mark.parametrize(
    ("name", "file", "expected"),
    [
        ("own.step", "/cache/a/own/step.py", ""),
        ("own.step", "/usr/lib/own/step.py", "own.step from /usr/lib/own/step.py"),
        (
            "own._fast",
            "/checkout/build/own/_fast.so",
            "own._fast from /checkout/build/own/_fast.so",
        ),
        ("other", "/checkout/src/other.py", "other from /checkout/src/other.py"),
        ("mjbench.paired", "/checkout/tools/mjbench/paired.py", ""),  # it measures
        ("numpy", "/checkout/.venv/lib/numpy/__init__.py", ""),
        ("json", "/usr/lib/json.py", ""),
    ],
)
def test_code_that_is_not_the_revisions_is_found(name: str, file: str, expected: str) -> None:
    environment = ["/checkout/.venv"]
    assert timed_function.misplaced({name: [file]}, ORIGIN, environment) == expected
