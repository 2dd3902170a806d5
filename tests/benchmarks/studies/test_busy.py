"""Whether advice on a busy machine is that of the quiet one."""

import pytest

from benchmarks.studies import busy, tally_file
from benchmarks.studies.page_part import of_lines
from mjbench.interval import Interval
from mjbench.paired.race_record import Loop


def test_the_page_has_the_committed_results() -> None:
    tally = tally_file.load(busy.TALLY, busy.BusyTally, "comparisons on a busy machine")
    assert busy.PART.text() == of_lines(tally.lines())


@pytest.mark.parametrize(
    ("regret", "low", "is_good", "holds"), [(0.05, 1.2, True, True), (0.06, 1.4, False, False)]
)
def test_advice_is_good_within_the_margin_and_its_interval_holds_the_quiet_speedup(
    regret: float, low: float, is_good: bool, holds: bool
) -> None:
    beside = Interval(1.5, low, 1.6)
    outcome = busy.Outcome("pile", "one", Loop.OPEN, True, "rollout", regret, 1.3, beside)
    assert (outcome.is_good, outcome.holds) == (is_good, holds)
