"""When launches of a pair end, and what is left of them then. Nothing is launched."""

from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest
from paired_examples import CARTPOLE

from mjbench.errors import MachineError
from mjbench.paired import pair_rule
from mjbench.paired.launches import Targets
from mjbench.paired.pair_rule import Launched, PairRule, Sufficiency
from mjbench.paired.records import LaunchRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.status import Status

LAUNCH = LaunchRow(0, None, ["ABBA"], [[1, 1, 1, 1]], AS_SHIPPED, [1])


class Enough(PairRule):
    """Launches until there is a number of them; four have an answer."""

    purpose = "a test"

    def __init__(self, count: int, limit_s: float, clock: Callable[[], float], problem: str):
        pool: Any = None
        super().__init__(pool, (CARTPOLE, CARTPOLE), Sizes(), limit_s, clock)
        self._count, self._problem = count, problem

    def placements(self, pool: WorkerPool) -> Iterator[PlacementPair]:
        if self._problem:
            raise MachineError(self._problem)
        return iter([AS_SHIPPED])

    def min_launches(self) -> int:
        return 4

    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        return Sufficiency(len(launches) >= self._count, has_answer=len(launches) >= 4)


class Pair(Targets[LaunchRow]):
    """Stands for two targets: each launch takes a second, or fails."""

    def __init__(
        self,
        clock: list[float],
        time_limit: TimeLimit,
        placements: Callable[[], object],
        error: BaseException | None,
    ):
        self._clock, self._error, self.is_closed = clock, error, False
        self.time_limit, self._placements = time_limit, placements
        self._count, self.work = 0, cast(Any, None)

    def prepare(self) -> None:
        self._placements()
        self.time_limit.start()
        self.work = SimpleNamespace(work_check="check", results=None, baseline_workload="file")

    def launch(self, positions: Sequence[int]) -> LaunchRow:
        assert positions == (0, 1)
        self._count += 1
        if self._count == 3 and self._error is not None:
            raise self._error
        self._clock[0] += 1.0
        return LAUNCH

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Launched]:
    """Return what launches until there is a number of launches."""

    def launch(
        count: int,
        problem: str = "",
        limit_s: float = 1e9,
        error: BaseException | None = None,
    ) -> Launched:
        clock, pairs = [0.0], list[Pair]()

        def pair(
            pool: Any, old: Any, new: Any, sizes: Any, limit: TimeLimit, placements: Any
        ) -> Pair:
            pairs.append(Pair(clock, limit, placements, error))
            return pairs[0]

        monkeypatch.setattr(pair_rule, "TargetPair", pair)
        result = Enough(count, limit_s, lambda: clock[0], problem).run()
        assert [pair.is_closed for pair in pairs] == [True]
        return result

    return launch


def test_launches_end_once_the_rule_has_enough(launched: Callable[..., Launched]) -> None:
    result = launched(5)
    assert (result.status, result.detail, result.is_enough) == (Status.OK, "", True)
    assert len(result.launches) == 5
    assert result.seconds == 5.0
    assert (result.work_check, result.workload_file) == ("check", "file")


def test_launches_end_with_the_time_limit_and_what_they_gave(
    launched: Callable[..., Launched],
) -> None:
    result = launched(50, limit_s=10.0)
    assert (result.status, result.detail, result.is_enough) == (Status.OK, "", False)
    assert len(result.launches) == 10


def test_a_time_limit_that_allows_no_answer_is_explained(launched: Callable[..., Launched]) -> None:
    result = launched(50, limit_s=2.0)
    assert result.status == Status.OK
    assert "a test needs at least 4 launches: give --budget 5s or more" in result.detail
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
    result = launched(5, error=error)
    assert (result.status, result.detail, result.is_enough) == (status, detail, False)
    assert len(result.launches) == 2


def test_a_rule_that_cannot_begin_says_why(launched: Callable[..., Launched]) -> None:
    result = launched(5, problem="its code cannot be moved")
    assert (result.status, result.detail) == (Status.FAILED, "its code cannot be moved")
    assert (result.launches, result.work_check) == ([], None)
