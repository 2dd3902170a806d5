"""How the time of a command is divided, on a clock that only the test moves."""

import pytest

from mjbench.measuring.budget import AROUND_S, LEAST_S, Budget, Shares


class Divided:
    """A budget of 31 seconds for three models, which are measured by a clock of its own."""

    def __init__(self, budget: Budget, count: int = 3) -> None:
        self.now_s, self.lines = 1000.0, list[str]()
        self.shares: Shares = budget.divided(count, self.lines.append, lambda: self.now_s)

    def next_s(self, taken_s: float = 0.0, effort: int = 1) -> float:
        share_s = self.shares.next_s(effort)
        self.now_s += taken_s
        return share_s


WHOLE = Budget(each_s=23.0, total_s=30.0 + AROUND_S)


def test_without_a_whole_each_thing_has_its_own_time() -> None:
    divided = Divided(Budget(each_s=23.0))
    assert [divided.next_s(100.0), divided.next_s(100.0)] == [23.0, 23.0]
    assert divided.next_s(effort=2) == 46.0
    assert divided.lines == []


def test_a_whole_is_divided_and_the_share_is_said() -> None:
    divided = Divided(Budget(each_s=23.0, total_s=60.0))
    assert divided.next_s() == pytest.approx((60.0 - AROUND_S) / 3)
    assert divided.lines == ["60s for 3 models: 20s each"]
    assert Divided(WHOLE, count=1).lines == []


def test_what_one_leaves_or_takes_too_much_is_shared_by_all_that_follow() -> None:
    divided = Divided(WHOLE)
    assert divided.next_s(taken_s=4.0) == 10.0
    assert divided.next_s(taken_s=20.0) == 13.0
    assert divided.next_s(taken_s=20.0) == 6.0
    assert divided.next_s() == LEAST_S


def test_a_second_try_has_two_shares_but_no_more_than_is_left() -> None:
    divided = Divided(WHOLE)
    assert divided.next_s(taken_s=10.0) == 10.0
    assert divided.next_s(taken_s=5.0, effort=2) == 20.0
    assert divided.next_s(effort=2) == 15.0


def test_what_came_before_counts() -> None:
    shares = WHOLE.divided(1, clock=lambda: 20.0, begin_s=0.0)
    assert shares.next_s() == 10.0


def test_one_thing_has_the_whole() -> None:
    assert WHOLE.whole_s == 30.0
    assert Budget(each_s=12.0).whole_s == 12.0 - AROUND_S
