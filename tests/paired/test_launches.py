"""The loop of launches: when it ends, and what is left of it then. Nothing is launched."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from paired_examples import CARTPOLE

from mjbench.errors import MachineError
from mjbench.paired import launches
from mjbench.paired.launches import Launched, StopRule, Sufficiency
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.status import Status

LAUNCH = LaunchRow(0, None, ["ABBA"], [[1, 1, 1, 1]], AS_SHIPPED, [1])


class Enough(StopRule):
    """Launches until there is a number of them; any has an answer."""

    purpose = "a test"

    def __init__(self, count: int, problem: str = ""):
        self._count, self._problem = count, problem

    def placements(self, pool: WorkerPool) -> Iterator[PlacementPair]:
        if self._problem:
            raise MachineError(self._problem)
        return iter([AS_SHIPPED])

    def min_launches(self) -> int:
        return 4

    def look(self, launches: Sequence[LaunchRow], work_check: WorkCheck) -> Sufficiency:
        return Sufficiency(len(launches) >= self._count, has_answer=len(launches) >= 4)


class Pair:
    """Stands for two targets: each launch takes a second, or fails."""

    work_check, baseline_workload = "check", "file"

    def __init__(self, clock: list[float], time_limit: TimeLimit, error: BaseException | None):
        self._clock, self._error, self.is_closed = clock, error, False
        self._count = 0
        time_limit.start()

    def launch(self) -> LaunchRow:
        self._count += 1
        if self._count == 3 and self._error is not None:
            raise self._error
        self._clock[0] += 1.0
        return LAUNCH

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Launched]:
    """Return what launches by a rule."""

    def launch(
        rule: StopRule, limit_s: float = 1e9, error: BaseException | None = None
    ) -> Launched:
        clock, pairs, pool = [0.0], list[Pair](), Any

        def pair(pool: Any, old: Any, new: Any, sizes: Any, time_limit: Any, _: Any) -> Pair:
            pairs.append(Pair(clock, time_limit, error))
            return pairs[0]

        monkeypatch.setattr(launches, "TargetPair", pair)
        targets = CARTPOLE, CARTPOLE
        result = launches.launch(pool, targets, Sizes(), rule, limit_s, lambda: clock[0])  # type: ignore[arg-type]
        assert all(pair.is_closed for pair in pairs)
        return result

    return launch


def test_launches_end_once_the_rule_has_enough(launched: Callable[..., Launched]) -> None:
    result = launched(Enough(5))
    assert (result.status, result.detail, result.is_enough) == (Status.OK, "", True)
    assert len(result.launches) == 5
    assert result.seconds == 5.0
    assert (result.work_check, result.workload_file) == ("check", "file")


def test_launches_end_with_the_time_limit_and_what_they_gave(
    launched: Callable[..., Launched],
) -> None:
    result = launched(Enough(50), limit_s=10.0)
    assert (result.status, result.detail, result.is_enough) == (Status.OK, "", False)
    assert len(result.launches) == 10


def test_a_time_limit_that_allows_no_answer_is_explained(launched: Callable[..., Launched]) -> None:
    result = launched(Enough(50), limit_s=2.0)
    assert result.status == Status.OK
    assert "a test needs at least 4 launches: give --time-limit 5s or more" in result.detail
    assert len(result.launches) == 2


@pytest.mark.parametrize(
    ("error", "status", "detail"),
    [
        (MachineError("it fell over"), Status.FAILED, "it fell over"),
        (KeyboardInterrupt(), Status.INTERRUPTED, "interrupted"),
    ],
)
def test_what_was_launched_before_a_failure_stays(
    launched: Callable[..., Launched], error: BaseException, status: Status, detail: str
) -> None:
    result = launched(Enough(5), error=error)
    assert (result.status, result.detail, result.is_enough) == (status, detail, False)
    assert len(result.launches) == 2


def test_a_rule_that_cannot_begin_says_why(launched: Callable[..., Launched]) -> None:
    result = launched(Enough(5, problem="its code cannot be moved"))
    assert (result.status, result.detail) == (Status.FAILED, "its code cannot be moved")
    assert (result.launches, result.work_check) == ([], None)
