"""From which size on a path overtakes others."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from example_records import JUDGED

from mjbench.measuring.ratio import Ratio
from mjbench.report.crossovers import (
    crossovers,
    curve_crossing,
    describe_work_crossover,
    work_crossovers,
)
from mjbench.report.path_speedups import PathResult
from mjbench.simulation.accelerated_judgement import EngineAnswer, Precision
from mjbench.status import Status


def swept(path: str, nbatch: int, ns: float, precision: Precision | None = None) -> PathResult:
    return PathResult(
        model="m",
        path=path,
        options={},
        status=Status.OK,
        nbatch=nbatch,
        nbatch_asked=nbatch,
        steps_per_s=1e9 / ns,
        precision=precision,
    )


@pytest.fixture
def rows() -> list[PathResult]:
    sizes = (1, 16, 64, 256)
    speeds = {1: 900.0, 16: 49.0, 64: 51.0, 256: 10.0}
    return [
        *(swept("python_loop", n, 100.0) for n in sizes),
        *(swept("rollout", n, 50.0) for n in sizes),
        *(swept("mjx", n, ns, Precision.FLOAT32) for n, ns in speeds.items()),
        *(swept("mjx64", n, 60.0, Precision.FLOAT64) for n in sizes),
    ]


def test_the_crossover_is_the_size_from_which_on_a_path_stays_ahead(
    rows: list[PathResult],
) -> None:
    first, second = crossovers(rows)
    assert (first.path, first.nbatch, first.rival.path) == ("mjx", 256, "rollout")
    assert (second.path, second.nbatch, second.largest) == ("mjx64", None, 256)
    assert second.share == pytest.approx(5 / 6)


def test_paths_that_were_not_judged_have_no_crossover(rows: list[PathResult]) -> None:
    unjudged = replace(JUDGED, answer=EngineAnswer.NOT_JUDGED)
    assert crossovers([replace(r, judgement=unjudged if r.precision else None) for r in rows]) == []


def test_one_size_is_no_sweep(rows: list[PathResult]) -> None:
    assert crossovers([row for row in rows if row.nbatch == 64]) == []


def test_a_curve_through_few_sizes_has_no_interval(rows: list[PathResult]) -> None:
    assert crossovers(rows)[0].curve is None
    assert curve_crossing({1: 0.1, 4: 0.5, 16: 1.5, 64: 3.0}) is None


def test_the_interval_of_a_crossing_covers_it_as_often_as_it_says() -> None:
    """Shares cross 1 at 100 simulations; each is off by 5 %, as processes differ."""
    rng = np.random.default_rng(0)
    sizes = np.array([1, 4, 16, 64, 256, 1024, 4096])
    covered = 0
    for _ in range(400):
        logs = 0.5 * np.log(sizes / 100) - 0.02 * np.log(sizes / 100) ** 2
        noisy = np.exp(logs + rng.normal(0, 0.05, len(sizes)))
        crossing = curve_crossing(dict(zip(sizes.tolist(), noisy.tolist(), strict=True)))
        assert crossing is not None
        assert crossing.low is not None
        assert crossing.high is not None
        covered += crossing.low <= 100 <= crossing.high
    assert 0.92 <= covered / 400 <= 0.98


def test_a_curve_that_stays_on_one_side_does_not_cross() -> None:
    ahead = curve_crossing({n: 1.5 + 0.01 * np.log(n) for n in (1, 4, 16, 64, 256)})
    assert ahead is not None
    assert ahead.nbatch is None
    behind = curve_crossing({n: 0.5 + 0.01 * np.log(n) for n in (1, 4, 16, 64, 256)})
    assert behind is not None
    assert (behind.nbatch, behind.high) == (None, None)


# the work of a call from which on Ray overtakes


# Nanoseconds of a step in the plain loop; what a call of Ray costs before it steps.
LOOP_NS, CALL_NS = 2000.0, 2e6
SIZES = (1, 10, 100)
NSTEP = 100


def timed(path: str, nbatch: int, ns: float, **options: Any) -> PathResult:
    return PathResult(
        model="m",
        path=path,
        options=options,
        status=Status.OK,
        nbatch=nbatch,
        nbatch_asked=nbatch,
        nstep=NSTEP,
        step_ns=ns,
        steps_per_s=1e9 / ns,
        speedup=Ratio(LOOP_NS / ns, None, None),
    )


def at(nbatch: int) -> list[PathResult]:
    """Return the results of one size: Ray is as fast as two threads, but for what a call costs."""
    ray_ns = LOOP_NS / 2.5 + CALL_NS / (nbatch * NSTEP)
    return [
        timed("python_loop", nbatch, LOOP_NS),
        timed("python_loop", nbatch, 0.5 * LOOP_NS, clock="off"),
        timed("rollout", nbatch, LOOP_NS / 1.25, threads=1),
        timed("rollout", nbatch, LOOP_NS / 2.5, threads=2, pool="kept"),
        timed("rollout", nbatch, LOOP_NS / 2, threads=2, pool="new"),
        timed("processes", nbatch, LOOP_NS / 1.9, processes=2),
        timed("batch_step", nbatch, 1.0, threads=2),
        timed("ray", nbatch, ray_ns, actors=2),
    ]


@pytest.fixture
def results() -> list[PathResult]:
    return [result for nbatch in SIZES for result in at(nbatch)]


def test_there_is_a_row_for_each_path_and_its_number_of_threads(results: list[PathResult]) -> None:
    assert [(row.rival.path, row.rival.options) for row in work_crossovers(results)] == [
        ("python_loop", {}),
        ("rollout", {"threads": 1}),
        ("rollout", {"threads": 2}),
        ("processes", {"processes": 2}),
    ]


def test_the_least_work_is_that_from_which_on_ray_stays_ahead(results: list[PathResult]) -> None:
    by_rival = {
        (row.rival.path, *row.rival.options.values()): row for row in work_crossovers(results)
    }
    loop = by_rival["python_loop",]
    assert loop.least is not None
    assert (loop.least.steps, loop.least.loop_ms) == (10_000, pytest.approx(20.0))
    assert loop.largest == loop.least
    assert loop.share == pytest.approx(2.0)
    assert by_rival["rollout", 1].least == loop.least
    assert by_rival["rollout", 2].least is None
    assert by_rival["rollout", 2].share == pytest.approx(0.8)


def test_the_fastest_variant_of_a_path_is_the_rival(results: list[PathResult]) -> None:
    slower_pool = [r for r in results if r.options.get("pool") != "kept"]
    (row,) = [r for r in work_crossovers(slower_pool) if r.rival.options == {"threads": 2}]
    assert row.share == pytest.approx(1.0)


def test_ray_that_failed_at_the_largest_size_overtakes_at_none(results: list[PathResult]) -> None:
    failed = [r for r in results if (r.path, r.nbatch) != ("ray", 100)]
    assert {row.least for row in work_crossovers(failed)} == {None}
    assert {row.largest.steps for row in work_crossovers(failed)} == {1000}


@pytest.mark.parametrize("sizes", [(10,), ()])
def test_one_size_of_calls_is_no_sweep(sizes: tuple[int, ...]) -> None:
    assert work_crossovers([result for nbatch in sizes for result in at(nbatch)]) == []


def test_without_ray_or_the_plain_loop_there_is_nothing_to_say(results: list[PathResult]) -> None:
    for path in ("ray", "python_loop"):
        assert work_crossovers([r for r in results if r.path != path]) == []


def test_the_sentences_say_steps_and_milliseconds(results: list[PathResult]) -> None:
    loop, _, threads, processes = map(describe_work_crossover, work_crossovers(results))
    assert loop == (
        "m: ray actors=2 overtakes python_loop at 10,000 steps per call (20 ms of the plain loop),"
        " of those tried"
    )
    assert threads == (
        "m: ray actors=2 does not overtake rollout threads=2 up to 10,000 steps per call (20 ms of"
        " the plain loop), where it has 0.80 of its speed; on one machine, rollout needs no Ray to"
        " use all cores"
    )
    assert "overtakes processes processes=2" in processes
