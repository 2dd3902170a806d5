"""What follows from the raw times of a launch, and what compiling took on one side."""

import numpy as np
import pytest

from mjbench.measuring.calls import Compilation
from mjbench.paired.records import CompilationFigures, LaunchRow
from mjbench.releases.placement import AS_SHIPPED


def launch(orders: list[str], ns: np.ndarray, layouts: list[int], nsection: int = 1) -> LaunchRow:
    return LaunchRow(None, None, orders, ns.tolist(), AS_SHIPPED, layouts, nsection)


def quads(ratios: list[float]) -> np.ndarray:
    """Return quads in which the candidate takes these times of the baseline's."""
    ones = np.ones(len(ratios))
    return 100.0 * np.stack([ones, ratios, ratios, ones], axis=1)


def test_the_log_ratio_is_candidate_over_baseline_whatever_the_order() -> None:
    ns = np.array([[100.0, 200.0, 200.0, 100.0], [200.0, 100.0, 100.0, 200.0]])
    assert np.exp(launch(["ABBA", "BAAB"], ns, [2]).log_ratio) == pytest.approx(2.0)


def test_the_cost_of_coming_second_cancels_within_a_quad() -> None:
    second_is_slower = np.array([[100.0, 101.0, 100.0, 101.0]])
    assert launch(["ABBA"], second_is_slower, [1]).log_ratio == pytest.approx(0.0)


def test_the_sections_of_a_launch_are_those_of_all_its_layouts() -> None:
    # the second layout is disturbed
    ns = quads([1.02, 1.04, 1.02, 1.04, 2.0, 2.0, 1.02, 1.04])
    divided = launch(["ABBA"] * 8, ns, [4, 2, 2], nsection=2)
    assert divided.log_ratio == pytest.approx(np.log(1.03), abs=1e-4)


def test_whole_runs_of_a_launch_differ_from_layout_to_layout() -> None:
    whole = launch(["ABBA"] * 5, quads([1.0, 1.0, 1.0, 1.3, 1.3]), [3, 2])
    assert whole.log_ratio == pytest.approx(np.log(2.3 / 2))


@pytest.mark.parametrize("nsection", [1, 2])
def test_quads_of_no_layout_are_all_of_one(nsection: int) -> None:
    ns = quads([1.02, 1.04] * 3)
    one = launch(["ABBA"] * 6, ns, [6], nsection)
    assert launch(["ABBA"] * 6, ns, [], nsection).log_ratio == one.log_ratio


def test_drift_of_the_machine_cancels_within_a_quad() -> None:
    drifting = np.exp(np.array([[0.0, 0.1, 0.2, 0.3]]))
    assert launch(["BAAB"], drifting, [1]).log_ratio == pytest.approx(0.0)


FRESH = Compilation(trace_s=2.0, compile_s=8.0, first_run_s=0.1, programs=31)
CACHED = Compilation(trace_s=2.2, compile_s=0.4, first_run_s=0.2, programs=31, is_cached=True)


def test_what_a_cache_holds_is_apart_from_what_was_compiled() -> None:
    figures = CompilationFigures.of([FRESH, *[CACHED] * 8], [0.01] * 8)
    assert (figures.compile_s.estimate, figures.compile_s.low) == (8.0, None)
    assert (figures.trace_s.estimate, figures.trace_s.low) == (2.2, 2.2)
    assert (figures.processes, figures.compiling_processes, figures.programs) == (9, 1, 31)


def test_a_median_has_an_interval_from_six_processes_on() -> None:
    five, six = (CompilationFigures.of([FRESH] * n, []) for n in (5, 6))
    assert five.compile_s.low is None
    assert (six.compile_s.low, six.compile_s.high) == (8.0, 8.0)


def test_an_engine_without_such_stages_has_no_figures_of_them() -> None:
    figures = CompilationFigures.of([Compilation(None, 1.0, 0.1)], [])
    assert figures.trace_s is None
    assert figures.steady_run_s is None
    assert figures.programs is None
    assert figures.first_run_s.estimate == pytest.approx(0.1)
