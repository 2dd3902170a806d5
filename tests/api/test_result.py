"""What a measurement in a program returns shows itself, and is what the command would store."""

import re
import sys
from collections.abc import Sequence
from dataclasses import FrozenInstanceError
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from example_races import compared, raced
from set_files import run_of
from step_profiles import step_profile
from verdict_records import SLOWER, of_model

import mjbench
from mjbench.api.compare import Comparison
from mjbench.api.profile import Profile
from mjbench.api.versions import ReleaseComparison
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.host import machine
from mjbench.measuring.timing import Progress
from mjbench.paired.records import VerdictRecord
from mjbench.results import runs
from mjbench.results.runs import Record, Run
from mjbench.session import Item, Items, Measurement, Observer

HOSTILE = "<img src=x onerror=alert(1)>&\x1b[31m"


def run(command: str, *records: Any, **arguments: Any) -> Run:
    return run_of(command, *records, machine=machine.describe(), arguments=arguments)


def verdict(model: str = "humanoid") -> VerdictRecord:
    return of_model(SLOWER, model)


class Cell:
    """What a notebook displays, in place of IPython."""

    def __init__(self, shell: object):
        self.lines: list[str] = []
        self.display = SimpleNamespace(display=self.displayed)
        self.get_ipython = lambda: shell

    def displayed(self, data: dict[str, str], *, raw: bool, display_id: bool) -> "Cell":
        assert raw and display_id
        return self.update(data, raw=raw)

    def update(self, data: dict[str, str], *, raw: bool) -> "Cell":
        self.lines.append(data["text/plain"])
        return self


def measured_in(monkeypatch: pytest.MonkeyPatch, cell: Cell, *on_progress: Progress) -> None:
    """Measure a step, with progress."""

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        observer.begin("m: racing")
        for _ in range(2):
            observer("m: launch 3", 0.25)
        yield Item([step_profile()])

    ipython: Any = cell
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    Profile.of(Measurement("profile", {}, [], items), False, *on_progress)


def test_a_notebook_shows_progress_in_a_line_that_is_empty_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cell = Cell(SimpleNamespace(kernel="a kernel"))
    measured_in(monkeypatch, cell)
    assert cell.lines == ["", "m: racing", "m: launch 3 (25 %)", ""]


def test_progress_goes_to_the_function_of_a_program_or_to_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cell, seen = Cell(SimpleNamespace(kernel="a kernel")), list[str]()
    measured_in(monkeypatch, cell, lambda name, share: seen.append(name))
    assert (cell.lines, seen) == ([], ["m: launch 3"] * 2)
    in_terminal = Cell(SimpleNamespace())
    measured_in(monkeypatch, in_terminal)
    assert in_terminal.lines == []


def comparison(model: str = "m") -> Comparison:
    return Comparison(run("compare", *compared(raced(model=model))))


def release_comparison(model: str = "humanoid", *notes: str) -> ReleaseComparison:
    return ReleaseComparison(run("versions", verdict(model), confidence=0.95), notes)


def profile() -> Profile:
    return Profile(run("profile", step_profile()))


EXAMPLES = {"compare": comparison, "versions": release_comparison, "profile": profile}


@pytest.mark.parametrize("command", EXAMPLES)
def test_a_saved_value_is_a_run_file_that_shows_the_same(command: str, tmp_path: Path) -> None:
    value = EXAMPLES[command]()
    file = value.save(tmp_path / "runs")
    again = type(value)(runs.load(file, RECORD_TYPES))
    assert str(again) == str(value)
    assert repr(again) == repr(value)
    assert again._repr_markdown_() == value._repr_markdown_()
    assert mjbench.load(file) == value.rows()


@pytest.mark.parametrize("command", EXAMPLES)
def test_a_value_is_frozen_and_its_repr_is_one_line_with_the_conclusion(command: str) -> None:
    value = EXAMPLES[command]()
    with pytest.raises(FrozenInstanceError):
        value.run = None  # type: ignore[misc, assignment]
    assert "\n" not in repr(value)
    assert value.report().conclusions[0].text[:40] in repr(value)


def test_the_verdict_comes_first_in_a_notebook_then_a_table() -> None:
    text = release_comparison()._repr_markdown_()
    assert text.index("slower by 3 %") < text.index("|---") < text.index("| humanoid")
    assert text.startswith("- ❌ ")


def test_notes_are_shown_in_every_form() -> None:
    value = release_comparison("humanoid", "The host took 20 %.")
    assert "The host took 20 %." in str(value)
    assert "The host took 20 %." in value._repr_markdown_()


@pytest.mark.parametrize("example", [comparison, release_comparison])
def test_names_of_others_are_escaped(example: Any) -> None:
    value = example(HOSTILE)
    assert not re.search(r"(?<!\\)<img", value._repr_markdown_())
    assert "\\<img" in value._repr_markdown_()
    assert "\x1b" not in str(value) + repr(value) + value._repr_markdown_()


def test_the_family_of_verdicts_has_the_confidence_that_was_asked_for() -> None:
    value = release_comparison()
    assert value.confidence == 0.95
    assert [row.model for row in value.family.slower] == ["humanoid"]


def test_a_comparison_has_advice_and_results() -> None:
    value = comparison()
    assert [advice.path for advice in value.advice] == ["rollout", "batch_step"]
    assert [result.path for result in value.results][:2] == ["python_loop", "rollout"]
    assert value.results[1].speedup == value.advice[0].speedup
    assert "--code" not in str(value)


def test_ipython_shows_the_table_in_a_terminal() -> None:
    class Printer:
        shown = ""

        def text(self, text: str) -> None:
            self.shown += text

    printer = Printer()
    profile()._repr_pretty_(printer, cycle=False)
    assert printer.shown == str(profile())
    assert "kinematics" in printer.shown
