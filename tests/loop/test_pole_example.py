"""The falling pole: the same counts by every path, and Wilson's interval."""

import math

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.loop import pole_example, pole_paths


def test_every_path_counts_the_same_falls() -> None:
    experiment = pole_example.measure(angles_rad=(0.0, 0.2, 0.4), samples=20, threads=(1, 2))
    counts = [path.counts for path in experiment.paths]
    assert counts == [counts[0]] * len(counts)
    assert len(counts) >= 3
    assert tuple(row.falls for row in experiment.angles) == counts[0]
    assert counts[0][0] < counts[0][-1]


def test_a_path_that_counts_differently_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pole_paths, "_passed_limit", lambda angles: abs(angles[:, 0]) < 0)
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


@pytest.mark.parametrize("angles_rad", [(), (0.1, math.nan), (math.inf,)])
def test_no_angle_or_one_that_is_not_finite_is_bad_input(angles_rad: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="finite angles"):
        pole_example.measure(angles_rad=angles_rad)


def test_more_samples_than_fit_into_memory_are_refused_before_any_is_drawn() -> None:
    with pytest.raises(InputError, match="reduce --samples"):
        pole_example.measure(samples=10**12)


def test_threads_that_the_system_does_not_start_are_an_error_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_thread(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(pole_paths, "_batch", no_thread)
    with pytest.raises(MachineError, match="reduce --threads"):
        pole_example.measure(angles_rad=(0.1,), samples=1, threads=(1,))
