"""What compiling took on one side, from its processes."""

import pytest

from mjbench.measuring.calls import Compilation
from mjbench.paired.records import CompilationFigures

FRESH = Compilation(trace_s=2.0, compile_s=8.0, first_run_s=0.1, programs=31)
CACHED = Compilation(trace_s=2.2, compile_s=0.4, first_run_s=0.2, programs=31, is_cached=True)


def test_what_a_cache_holds_is_apart_from_what_was_compiled() -> None:
    figures = CompilationFigures.of([FRESH, *[CACHED] * 8], [0.01] * 8)
    assert figures.compile_s is not None
    assert (figures.compile_s.median, figures.compile_s.low) == (8.0, None)
    assert figures.trace_s is not None
    assert (figures.trace_s.median, figures.trace_s.low) == (2.2, 2.2)
    assert (figures.processes, figures.compiling_processes, figures.programs) == (9, 1, 31)


def test_a_median_has_an_interval_from_six_processes_on() -> None:
    five, six = (CompilationFigures.of([FRESH] * n, []) for n in (5, 6))
    assert five.compile_s is not None
    assert five.compile_s.low is None
    assert six.compile_s is not None
    assert (six.compile_s.low, six.compile_s.high) == (8.0, 8.0)


def test_an_engine_without_such_stages_has_no_figures_of_them() -> None:
    figures = CompilationFigures.of([Compilation(None, 1.0, 0.1)], [])
    assert figures.trace_s is None
    assert figures.steady_run_s is None
    assert figures.programs is None
    assert figures.first_run_s.median == pytest.approx(0.1)
