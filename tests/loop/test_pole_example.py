"""The falling pole: the same counts by every path, and Wilson's interval."""

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.loop import pole_example


def test_every_path_counts_the_same_falls() -> None:
    experiment = pole_example.measure(angles_rad=(0.0, 0.2, 0.4), samples=20, threads=(1, 2))
    counts = [path.counts for path in experiment.paths]
    assert counts == [counts[0]] * len(counts)
    assert len(counts) >= 3
    assert tuple(row.falls for row in experiment.angles) == counts[0]
    assert counts[0][0] < counts[0][-1]


def test_a_path_that_counts_differently_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pole_example, "_passed_limit", lambda angles: abs(angles[:, 0]) < 0)
    with pytest.raises(MachineError, match="the Python loop"):
        pole_example.measure(angles_rad=(0.1, 0.2), samples=50, threads=(1,))


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
    successes: int, trials: int, low: float, high: float
) -> None:
    """Figures of Newcombe, Statistics in Medicine 17, 1998, and of the closed form at the ends."""
    proportion = pole_example.wilson(successes, trials)
    assert proportion.share == successes / trials
    assert (proportion.low, proportion.high) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(("successes", "trials"), [(-1, 5), (6, 5), (0, 0)])
def test_impossible_counts_are_refused(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match="of"):
        pole_example.wilson(successes, trials)


def test_no_angle_is_bad_input() -> None:
    with pytest.raises(InputError):
        pole_example.measure(angles_rad=())
