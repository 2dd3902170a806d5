"""From which size on a path overtakes others."""

from dataclasses import replace

import pytest
from example_records import JUDGED, model_record

from mjbench.commands.compare.crossovers import crossovers
from mjbench.commands.compare.results import PathResult
from mjbench.simulation.accelerated_judgement import EngineAnswer, Precision
from mjbench.status import Status


def swept(path: str, nbatch: int, ns: float, precision: Precision | None = None) -> PathResult:
    return PathResult(
        model="m",
        path=path,
        options={},
        status=Status.OK,
        model_record=model_record(nbatch=nbatch),
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


def test_the_crossover_is_the_size_from_which_on_a_path_stays_ahead(rows: list[PathResult]) -> None:
    first, second = crossovers(rows)
    assert (first.path, first.nbatch, first.rival.path) == ("mjx", 256, "rollout")
    assert (second.path, second.nbatch, second.largest) == ("mjx64", None, 256)
    assert second.share == pytest.approx(5 / 6)


def test_paths_that_were_not_judged_have_no_crossover(rows: list[PathResult]) -> None:
    unjudged = replace(JUDGED, answer=EngineAnswer.NOT_JUDGED)
    assert crossovers([replace(r, judgement=unjudged if r.precision else None) for r in rows]) == []


def test_one_size_is_no_sweep(rows: list[PathResult]) -> None:
    assert crossovers([row for row in rows if row.nbatch_asked == 64]) == []
