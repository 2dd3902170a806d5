"""What the processes of a launch do, by what is compared."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from paired_examples import CARTPOLE

from mjbench.errors import InputError
from mjbench.paired import operations, protocol
from mjbench.paired.outcomes import Metric, ResultsOutcome
from mjbench.paired.protocol import TargetPair
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models


@pytest.fixture(autouse=True)
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have as few blocks as there can be."""
    monkeypatch.setattr(protocol, "quad_count", lambda all_blocks_s, nsection: 1)
    monkeypatch.setattr(protocol, "layout_count", lambda all_blocks_s, nsection: 1)
    monkeypatch.setattr(protocol, "MAX_LAYOUTS", 1)


@pytest.fixture(params=["load", "reset", "rays", "rollout", "batch", "memory", "growth"])
def launched(pool: WorkerPool, request: pytest.FixtureRequest) -> Iterator[TargetPair]:
    """Yield a pair that is prepared, by one metric after the other."""
    pair = TargetPair(pool, CARTPOLE, CARTPOLE, Sizes(metric=Metric(request.param)))
    pair.prepare()
    yield pair
    pair.close()


def is_of_memory(launch: LaunchRow) -> bool:
    """Return whether all readings are between the unit of growth and the memory of a computer."""
    return all(1e5 < reading < 1e10 for quad in launch.ns for reading in quad)


def test_a_target_against_itself_does_the_same_by_every_metric(launched: TargetPair) -> None:
    launch = launched.launch()
    assert len(launch.orders) == 1
    assert abs(launch.log_ratio) < 1.0
    metric = launched._sizes.metric
    if metric in (Metric.MEMORY, Metric.GROWTH):
        assert launched.results is None
        assert launched.work_check is not None
        assert not launched.work_check.changed
        assert is_of_memory(launch)
        assert abs(launch.log_ratio) < 0.1
    else:
        assert launched.work_check is None
        assert launched.results is not None
        assert launched.results.outcome == ResultsOutcome.SAME


def test_loading_is_of_a_source_and_not_of_a_compiled_model(tmp_path: Path) -> None:
    file = tmp_path / "model.mjb"
    models.save(models.load(CARTPOLE.model), file)
    with pytest.raises(InputError, match=r"model\.mjb is compiled"):
        operations.find("load", 1).prepared(file)
