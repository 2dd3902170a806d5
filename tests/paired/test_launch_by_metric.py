"""What the processes of a launch do, by what is compared."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from paired_examples import BRIEF_SIZES, CARTPOLE

from mjbench.errors import InputError
from mjbench.paired import operations, pair_launches
from mjbench.paired.metrics import Metric
from mjbench.paired.operations import PreparedOperation
from mjbench.paired.outcomes import ResultsOutcome
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.target_pair import OperationPair, TargetPair, pair_of
from mjbench.paired.worker_answers import ReadyOperation
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource


@pytest.fixture(autouse=True)
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have as few blocks as there can be."""
    monkeypatch.setattr(pair_launches, "quad_count", lambda all_blocks_s, nsection: 1)
    monkeypatch.setattr(pair_launches, "layout_count", lambda all_blocks_s, nsection: 1)
    monkeypatch.setattr(pair_launches, "MAX_LAYOUTS", 1)


@pytest.fixture(params=["load", "reset", "rays", "rollout", "batch", "memory"])
def launched(pool: WorkerPool, request: pytest.FixtureRequest) -> Iterator[TargetPair]:
    """Yield a pair that is prepared, by one metric after the other."""
    pair = pair_of(pool, (CARTPOLE, CARTPOLE), replace(BRIEF_SIZES, metric=Metric(request.param)))
    pair.prepare()
    yield pair
    pair.close()


def is_of_memory(launch: LaunchRow) -> bool:
    """Return whether all readings are of a process: more than 100 kB, less than 10 GB."""
    return all(1e5 < reading < 1e10 for quad in launch.ns for reading in quad)


def test_a_target_against_itself_does_the_same_by_every_metric(launched: TargetPair) -> None:
    launch = launched.launch()
    assert len(launch.orders) == 1
    assert abs(launch.log_ratio) < 1.0
    if launched._sizes.metric == Metric.MEMORY:
        assert launched.results is None
        assert not launched.work.changes
        assert is_of_memory(launch)
        assert abs(launch.log_ratio) < 0.1
    else:
        assert launched.work is None
        assert launched.results.outcome == ResultsOutcome.SAME


@pytest.mark.parametrize("differs", [False, True])
def test_all_that_a_block_of_an_operation_computes_is_compared(
    monkeypatch: pytest.MonkeyPatch, differs: bool
) -> None:
    """The two sides differ in the last ray alone, of as many as take a millisecond."""

    def cast_rays(source: ModelSource, repeats: int) -> PreparedOperation:
        hits = np.zeros(repeats)
        hits[10:] = differs and source.path.stem == "candidate"
        return PreparedOperation(lambda: None, lambda: hits)

    class Process:
        def call(self, task: Any, prepare: Any, cores: Any) -> ReadyOperation:
            return ReadyOperation(50_000, prepare().result())

    @contextlib.contextmanager
    def loaded(pair: OperationPair) -> Iterator[Any]:
        pair.models = Path("baseline.mjb"), Path("candidate.mjb")
        yield [Process(), Process()]

    monkeypatch.setattr(OperationPair, "loaded", loaded)
    monkeypatch.setattr(operations, "cast_rays", cast_rays)
    pool, targets = cast(WorkerPool, None), (CARTPOLE, CARTPOLE)
    pair = OperationPair(pool, targets, Sizes(metric=Metric.RAYS))
    pair.fix_work()
    expected = ResultsOutcome.DIFFERENT if differs else ResultsOutcome.SAME
    assert pair.results.outcome == expected


def test_loading_is_of_a_source_and_not_of_a_compiled_model(tmp_path: Path) -> None:
    file = tmp_path / "model.mjb"
    models.save(models.load(CARTPOLE.model), file)
    with pytest.raises(InputError, match=r"model\.mjb is compiled"):
        operations.load(ModelSource("", file), 1)
