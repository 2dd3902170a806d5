"""From which size on a path overtakes others."""

from dataclasses import replace

import numpy as np
import pytest
from example_records import JUDGED

from mjbench.commands.compare.crossovers import crossovers, curve_crossing
from mjbench.commands.compare.results import PathResult
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
