"""docs/examples/falls.py: the cart-pole's falls, the same in every way of stepping."""

import re
from types import ModuleType

import numpy as np
import pytest
from commands import load_example


@pytest.fixture(scope="module")
def falls() -> ModuleType:
    return load_example("falls")


def test_every_way_counts_the_same_falls(
    falls: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    falls.main(5)
    printed = capsys.readouterr().out
    assert re.findall(r"^(\w+) +[\d.]+ s$", printed, flags=re.M) == [*falls.WAYS]
    assert "batch" in falls.WAYS
    assert "0.40 rad  1.000 (0.566 to 1.000)" in printed


def test_a_way_that_counts_differently_ends_it(
    falls: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(initial: np.ndarray) -> np.ndarray:
        return np.zeros(len(initial), dtype=bool)

    monkeypatch.setitem(falls.WAYS, "rollout", never)
    with pytest.raises(SystemExit, match=r"rollout counts .* falls, the loop"):
        falls.main(2)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (5, 10, 0.2366, 0.7634),
        (10, 10, 0.7225, 1.0),
        (81, 263, 0.2553, 0.3662),
    ],
)
def test_wilsons_interval_matches_published_figures(
    falls: ModuleType, successes: int, trials: int, low: float, high: float
) -> None:
    """Figures of Newcombe, Statistics in Medicine 17, 1998, and of the closed form at the ends."""
    assert falls.wilson(successes, trials) == pytest.approx((low, high), abs=1e-4)
