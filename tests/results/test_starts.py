"""What is said of start states, and of the steps from them."""

from dataclasses import replace

import pytest

from mjbench.results.starts import starts_lines
from mjbench.simulation.starts import Later, SettleLimit, Starts, Window

WINDOW = Window(64, 100, 8.1)
RUN = Starts(5.0, 5.0, window=WINDOW)


@pytest.mark.parametrize(
    ("starts", "line"),
    [
        (RUN, "64 starts from 5 to 10 s of a simulation, 100 steps each"),
        (Starts(0.0, 0.0, window=Window(1, 1, 8.1)), "1 start at keyframe 0, 1 step each"),
        (
            replace(RUN, controls_file="a.npy"),
            "64 starts from 5 to 10 s of a simulation, controls of a.npy, 100 steps each",
        ),
        (
            Starts(0.0, 0.0, file="s.npz", window=WINDOW),
            "64 starts from s.npz, random controls, 100 steps each",
        ),
        (
            Starts(0.0, 0.0, file="s.npz", controls_file="s.npz", window=WINDOW),
            "64 starts and their controls from s.npz, 100 steps each",
        ),
        (
            Starts(0.0, 0.0, file="s.npz", controls_file="a.npy", window=WINDOW),
            "64 starts from s.npz, controls of a.npy, 100 steps each",
        ),
    ],
)
def test_one_line_says_where_starts_are_from_and_what_was_stepped(
    starts: Starts, line: str
) -> None:
    assert starts_lines(starts) == [f"{line}, 8.1 contacts a step"]


def test_older_files_say_only_which_files_were_read() -> None:
    assert starts_lines(None) == starts_lines(Starts(0.1, 0.1)) == []
    assert starts_lines(Starts(0.0, 0.0, file="s.npz")) == ["Starts from s.npz, random controls"]


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"solver_limited": 0.98}, "stopped at its limit of iterations in 98 % of the steps"),
        ({"flat_hfields": 1}, "1 height field is flat (all zero)"),
        ({"flat_hfields": 2}, "2 height fields are flat (all zero)"),
        ({"later": Later(10.0, 12.0)}, "At 10 s of a simulation the model has 12 contacts a step"),
        ({"asleep": 0.1, "asleep_in_run": 0.9}, "do not show what sleeping saves"),
        ({"asleep": 0.9, "asleep_in_run": 0.9}, "90 % of the model slept in these steps, as in"),
        ({"asleep": 0.1}, "all of it is awake at each start"),
        ({"warnings": {"CNSTRFULL": 3}}, "memory was full (CNSTRFULL in 3 simulations)"),
    ],
)
def test_what_limits_the_figures_has_a_line(change: dict[str, object], part: str) -> None:
    window = replace(WINDOW, **change)  # type: ignore[arg-type]
    _, line = starts_lines(replace(RUN, window=window))
    assert part in line


def test_little_changes_and_few_limits_are_not_mentioned() -> None:
    window = replace(WINDOW, solver_limited=0.5, later=Later(10.0, 9.0))
    assert len(starts_lines(replace(RUN, window=window))) == 1


def test_a_shorter_settling_run_and_divergence_are_mentioned() -> None:
    short = replace(RUN, settle_s=0.5, limit=SettleLimit.COST)
    assert "settled for 0.5 s instead of 5 s" in starts_lines(short)[1]
    diverged = replace(RUN, settle_s=0.0, limit=SettleLimit.DIVERGED)
    assert "settled for 5 s, the model diverges" in starts_lines(diverged)[1]
