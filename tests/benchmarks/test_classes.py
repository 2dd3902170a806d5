"""The asv benchmark classes as pytest-benchmark cases.

`pytest --benchmark-only` times them with the MuJoCo at hand; a plain `pytest` runs each once,
untimed, over the models whose step is cheap.
"""

import functools
import importlib
import inspect
import itertools
import math
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

import benchmarks
from benchmarks import stored
from mjbench.errors import MachineError
from mjbench.releases import install_check
from mjbench.simulation import models


@dataclass(frozen=True)
class Case:
    """One benchmark method with one set of parameters."""

    kind: type
    method: str
    params: tuple[Any, ...]

    def __str__(self) -> str:
        words = "-".join(map(str, self.params))
        return f"{self.kind.__name__}.{self.method}" + (f"[{words}]" if words else "")

    @property
    def model(self) -> str:
        names = getattr(self.kind, "param_names", ())
        return str(self.params[names.index("model")]) if "model" in names else "no model"

    def bound(self) -> Any:
        """Return the method after `setup`; a benchmark that does not apply here is skipped."""
        instance = self.kind()
        first = [_cached(self.kind)] if hasattr(self.kind, "setup_cache") else []
        try:
            getattr(instance, "setup", lambda *params: None)(*first, *self.params)
        except NotImplementedError as reason:
            pytest.skip(str(reason))
        return functools.partial(getattr(instance, self.method), *first)


@functools.cache
def _cached(kind: Any) -> Any:
    """Return what asv would hand to every benchmark of a class."""
    return kind().setup_cache()


def classes() -> Iterator[type]:
    for module in pkgutil.iter_modules(benchmarks.__path__):
        found = importlib.import_module(f"benchmarks.{module.name}")
        for name, kind in inspect.getmembers(found, inspect.isclass):
            if kind.__module__ == found.__name__ and not name.startswith("_"):
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
    asked = metafunc.config.getoption("benchmark_only")
    for fixture, prefixes in (("timed", ("time_", "timeraw_")), ("exact", ("track_", "peakmem_"))):
        if fixture in metafunc.fixturenames:
            found = [c for c in cases(*prefixes) if asked or c.model not in stored.HEAVY]
            metafunc.parametrize(fixture, found, ids=str)


def test_time(timed: Case, benchmark: Any) -> None:
    method = timed.bound()
    run = _raw(method()) if timed.method.startswith("timeraw_") else method
    params = () if timed.method.startswith("timeraw_") else timed.params
    benchmark.group = timed.model
    returned = benchmark.pedantic(run, args=params, rounds=10, warmup_rounds=1)
    assert returned is None
    named = re.match(r"time_(\d+)_(steps)?", timed.method)
    if named and benchmark.stats:
        key = "ns_per_step" if named[2] else "ns_each"
        benchmark.extra_info[key] = 1e9 * benchmark.stats.stats.median / int(named[1])


def _raw(code: str) -> Any:
    def run() -> None:
        subprocess.run([sys.executable, "-c", code], check=True)

    return run


def test_counts_and_differences_are_numbers(exact: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.mjx.ROUNDS", 3)  # a number is asked for, not a good one
    try:
        value = exact.bound()(*exact.params)
    except MachineError as error:  # such as no network to install the reference release from
        pytest.skip(str(error))
    if exact.method.startswith("peakmem_"):
        assert value is None  # asv reads the memory of the process
    else:
        assert math.isfinite(value)
        assert value >= 0


def test_every_benchmark_has_an_explicit_version_and_a_name_for_readers() -> None:
    for case in cases("time_", "timeraw_", "track_", "peakmem_"):
        assert case.kind.version, case  # type: ignore[attr-defined]
        assert getattr(case.kind, case.method).pretty_name, case


def test_every_timed_benchmark_gives_the_20_samples_that_asv_needs() -> None:
    for case in cases("time_", "timeraw_"):
        kind: Any = case.kind
        assert kind.repeat * kind.rounds >= 20, case


@pytest.mark.parametrize("name", models.shipped())
def test_stored_states_are_of_the_model_as_it_is(name: str) -> None:
    assert stored.stored_digest(name) == stored.mjcf_digest(name), (
        f"{name}.xml was changed: python -m benchmarks.stored, and raise the versions"
    )


@pytest.mark.parametrize("name", [n for n in models.shipped() if n not in stored.HEAVY])
def test_the_release_that_stored_the_states_does_not_drift(name: str) -> None:
    if str(stored._read("release")) != install_check.installed_version():
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

    stored.prepared.cache_clear()
    monkeypatch.setattr("mjbench.paths.find", lambda name: ColdWarmStart())
    with pytest.raises(RuntimeError, match="disagrees with the plain loop"):
        stored.prepared("python_loop", ("cube_table",))
    stored.prepared.cache_clear()
