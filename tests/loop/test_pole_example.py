"""The falling pole: the same counts by every path, and Wilson's interval."""

import json
from pathlib import Path

import pytest
from commands import mjbench

from mjbench.errors import InputError, MachineError
from mjbench.loop import pole_example


def test_every_path_counts_the_same_falls() -> None:
    found = pole_example.ask(angles=(0.0, 0.2, 0.4), samples=20, threads=(1, 2))
    assert [way.counts for way in found.ways] == [found.ways[0].counts] * len(found.ways)
    assert len(found.ways) >= 3
    first, *_, last = found.ways[0].counts
    assert first < last


def test_a_path_that_counts_otherwise_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pole_example, "_passed", lambda angles: abs(angles[:, 0]) < 0)
    with pytest.raises(MachineError, match="the loop"):
        pole_example.ask(angles=(0.1, 0.2), samples=50, threads=(1,))


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (5, 10, 0.2366, 0.7634),
        (10, 10, 0.7225, 1.0),
        (81, 263, 0.2553, 0.3662),
    ],
)
def test_wilsons_interval_is_that_of_the_tables(
    successes: int, trials: int, low: float, high: float
) -> None:
    """Figures of Newcombe, Statistics in Medicine 17, 1998, and of the closed form at the ends."""
    share, below, above = pole_example.wilson(successes, trials)
    assert share == successes / trials
    assert (below, above) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(("successes", "trials"), [(-1, 5), (6, 5), (0, 0)])
def test_counts_that_cannot_be_are_refused(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match="of"):
        pole_example.wilson(successes, trials)


def test_no_angle_is_bad_input() -> None:
    with pytest.raises(InputError):
        pole_example.ask(angles=())


def test_the_command_prints_bars_and_writes_json(tmp_path: Path) -> None:
    done = mjbench(
        *("falls", "--angles", "0.1,0.4", "--samples", "10", "--threads", "1", "--json", "o.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "o.json").read_text())
    assert [row["angle"] for row in document["angles"]] == [0.1, 0.4]
    assert "0.40 rad" in done.stdout
    assert "same falls" in done.stdout
