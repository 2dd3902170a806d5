"""The page of one release, from the committed history."""

import pytest
from commands import ROOT

from mjbench.report import history_files, release_page
from mjbench.report.speed_history import SpeedHistory


@pytest.fixture(scope="module")
def history() -> SpeedHistory:
    names = ("ratios", "counts", "operations")
    files = [ROOT / f"results/history/reference-{name}.jsonl" for name in names]
    return history_files.read(files, None)


def test_a_release_that_changed_speed_says_so_first(history: SpeedHistory) -> None:
    lines = list(release_page.lines(history, "3.3.1"))
    assert lines[0] == "# MuJoCo 3.3.1\n"
    assert lines[1].startswith("A step became slower for ")
    assert "cartpole" in lines[1]
    (listed,) = [line for line in lines if line.startswith("| 3.3.0 → 3.3.1 | `cartpole`")]
    assert "code" in listed
    rows = [line for line in lines if " | 3.3.0 | " in line]
    assert len(rows) == len(history.models)
    assert not any("3.3.5 → 3.3.6" in line for line in lines)


def test_a_release_without_a_change_says_so(history: SpeedHistory) -> None:
    lines = list(release_page.lines(history, "3.2.1"))
    assert lines[1].startswith("No change point of a step among ")


def test_operations_have_a_part_where_they_were_measured(history: SpeedHistory) -> None:
    assert any("around the step" in line for line in release_page.lines(history, "4.0.0"))
