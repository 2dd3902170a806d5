"""What a command prints and stores of what it measures, and what it says of the machine."""

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from mjbench.cli.context import RunContext, measure_and_print
from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.commands.shared_options import OutputOptions
from mjbench.commands.show import forms, kinds, reports
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.errors import Failure, MachineError
from mjbench.host import machine, neighbours
from mjbench.host.disturbance import Disturbance
from mjbench.host.machine import ProcessorTime
from mjbench.host.neighbours import Neighbour
from mjbench.results import runs
from mjbench.results.content import Section, Tone
from mjbench.results.run_writer import RunFile
from mjbench.results.runs import Record, Run
from mjbench.session import Item, Items, Measurement, Observer, Session
from mjbench.status import Status


def row(model: str, status: Status = Status.UNAVAILABLE) -> OverheadRow:
    return OverheadRow(model=model, status=status, detail="no reason")


def names(run: Run) -> list[Section]:
    return [Section(" and ".join(record.model for record in run.of_type(OverheadRow)))]


def measured(
    items: Callable[[], Iterator[Item]], folder: Path, resume: Path | None = None
) -> RunContext:
    """Measure items, of which each is printed as the names of its models."""

    def yielded(earlier: Sequence[Record], observer: Observer) -> Items:
        yield from (Item([record]) for record in earlier)
        yield from items()

    measurement = Measurement("overhead", {}, [], yielded)
    return measure_and_print(measurement, OutputOptions(results=folder, resume=resume), each=names)


def nothing(earlier: Sequence[Record], observer: Observer) -> Items:
    yield from ()


def stored(folder: Path) -> list[str]:
    (file,) = folder.glob("*.jsonl")
    return [each.model for each in runs.load(file, RECORD_TYPES).of_type(OverheadRow)]


def test_parts_are_stored_at_once_and_shown_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def items() -> Iterator[Item]:
        yield Item([row("a")], is_part=True)
        assert stored(tmp_path) == ["a"]
        assert "a" not in capsys.readouterr().out
        yield Item([row("b")])
        yield Item([row("c")])

    measured(items, tmp_path)
    assert capsys.readouterr().out.split("\n\n")[:2] == ["\na and b", "c"]
    assert stored(tmp_path) == ["a", "b", "c"]


def test_what_cannot_be_measured_is_a_line_and_an_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def items() -> Iterator[Item]:
        yield Item([row("a", Status.INPUT)], Failure(Status.INPUT, "a: it is broken"))
        yield Item(failure=Failure(Status.FAILED, "b: no memory"))

    run = measured(items, tmp_path)
    out, err = capsys.readouterr()
    assert err == "mjbench: a: it is broken\nmjbench: b: no memory\n"
    assert out.startswith("\nRun file: ")
    assert stored(tmp_path) == ["a"]
    with pytest.raises(SystemExit, match="3"):
        run.exit()


@pytest.mark.parametrize("is_raised", [True, False])
def test_an_interrupt_leaves_what_was_measured(tmp_path: Path, is_raised: bool) -> None:
    def items() -> Iterator[Item]:
        yield Item([row("a")])
        if is_raised:
            raise KeyboardInterrupt
        yield Item([row("b", Status.INTERRUPTED)])
        raise AssertionError("nothing is measured after it")

    run = measured(items, tmp_path)
    assert stored(tmp_path)[0] == "a"
    with pytest.raises(SystemExit, match="130"):
        run.exit()


def test_files_have_what_was_measured_before_an_interrupt_as_show_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.13)

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        yield Item([row("a")])
        raise KeyboardInterrupt

    names = {"csv_file": "a.csv", "markdown_file": "a.md", "json_file": "a.json"}
    options = OutputOptions(
        results=tmp_path, **{key: str(tmp_path / name) for key, name in names.items()}
    )
    run = measure_and_print(Measurement("overhead", {}, [], items), options)
    with pytest.raises(SystemExit, match="130"):
        run.exit()
    forms_of_show = forms.of_runs(reports.read([*tmp_path.glob("*.jsonl")]))
    assert "the host took 13 %" in forms_of_show.markdown()
    assert (tmp_path / "a.md").read_text() == forms_of_show.markdown()
    assert (tmp_path / "a.csv").read_bytes() == forms_of_show.csv().encode()
    assert (tmp_path / "a.json").read_text() == forms_of_show.json()


def test_a_page_that_cannot_be_drawn_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    options = OutputOptions(results=tmp_path / "runs", html_file=str(tmp_path / "a.html"))
    with pytest.raises(MachineError, match="--html needs jinja2: python -m pip install"):
        measure_and_print(Measurement("overhead", {}, [], nothing), options)
    assert not [*tmp_path.iterdir()]


def test_an_interrupt_while_results_are_printed_names_where_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(run: Run) -> list[Section]:
        raise KeyboardInterrupt

    measurement = Measurement("overhead", {}, [], lambda *_: (Item([each]) for each in [row("a")]))
    with pytest.raises(SystemExit, match="130"):
        measure_and_print(measurement, OutputOptions(results=tmp_path), summary=interrupted)
    assert capsys.readouterr().err == "mjbench: interrupted; what was measured is saved\n"
    assert stored(tmp_path) == ["a"]


def test_records_of_a_continued_run_are_shown_and_not_stored_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    measured(lambda: iter([Item([row("a")])]), tmp_path)
    capsys.readouterr()
    measured(lambda: iter([Item([row("b")])]), tmp_path, Path("-1"))
    assert capsys.readouterr().out.split("\n\n")[:2] == ["\na", "b"]
    assert stored(tmp_path) == ["a", "b"]


def test_a_full_disk_ends_a_command_once_it_has_shown_what_it_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(file: RunFile, record: object) -> None:
        raise MachineError("cannot write")

    def items() -> Iterator[Item]:
        yield Item([row("a")])
        raise AssertionError("nothing is measured after it")

    monkeypatch.setattr(RunFile, "append", fail)
    run = measured(items, tmp_path)
    assert capsys.readouterr().out.startswith("\na\n")
    with pytest.raises(MachineError):
        run.exit()


@pytest.mark.parametrize(("share", "is_reported"), [(0.13, True), (0.01, False)])
def test_time_that_the_host_took_is_reported_where_it_matters(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    share: float,
    is_reported: bool,
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: share)
    with RunContext(session=Session(Measurement("versions", {}, [], nothing))):
        pass
    expected = "Disturbed: the host took 13 % of the processor time for others. Measure again."
    assert (expected in capsys.readouterr().out) == is_reported


def test_a_core_that_was_lost_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    allowed = iter([2.0, 1.5])
    monkeypatch.setattr(machine, "allowed_cores", lambda: next(allowed))
    monkeypatch.setattr(machine, "usable_cores", lambda: 2)
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.0)
    with RunContext(session=Session(Measurement("versions", {}, [], nothing))):
        pass
    assert "the usable cores changed from 2 to 1.5" in capsys.readouterr().out


def test_what_disturbed_a_run_is_its_last_record_and_comes_first_when_it_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.13)
    measured(lambda: iter([Item([row("a")])]), tmp_path)
    (file,) = tmp_path.glob("*.jsonl")
    run = runs.load(file, RECORD_TYPES)
    assert run.records[-1] == Disturbance([], 0.13)
    first, *_ = kinds.kind_of(run).sections(run)[0].conclusions
    assert (first.tone, first.text[:29]) == (Tone.CAUTION, "Disturbed: the host took 13 %")


def test_a_continued_run_has_what_disturbed_it_before_and_since(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.13)
    measured(lambda: iter([Item([row("a")])]), tmp_path)
    (file,) = tmp_path.glob("*.jsonl")
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.5)
    measured(lambda: iter([Item([row("b")])]), tmp_path, file)
    run = runs.load(file, RECORD_TYPES)
    assert run.of_type(Disturbance) == [Disturbance([], 0.13), Disturbance([], 0.5)]


def test_a_command_that_measures_no_time_says_nothing_of_the_host(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.5)
    with RunContext(session=Session(Measurement("instructions", {}, [], nothing), wait=None)):
        pass
    assert capsys.readouterr().out == ""


def test_others_that_measure_are_named_at_the_beginning_and_at_the_end(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, later = Neighbour(7, "compare"), Neighbour(8, "ab")
    seen = iter([[first], [first, later]])
    monkeypatch.setattr(neighbours, "measuring_now", lambda: next(seen))
    with RunContext(session=Session(Measurement("versions", {}, [], nothing), report=print)):
        assert (
            "is measuring on this machine (mjbench compare, process 7)" in capsys.readouterr().out
        )
    assert (
        "mjbench ab, mjbench compare measured on this machine at the same time"
        in capsys.readouterr().out
    )


def test_what_measures_ends_where_printing_fails(tmp_path: Path) -> None:
    ended = []

    def items() -> Items:
        try:
            yield Item([row("a")])
        finally:
            ended.append(True)

    def fail(run: Run) -> list[Section]:
        raise BrokenPipeError

    measurement = Measurement("overhead", {}, [], lambda *_: items())
    with pytest.raises(BrokenPipeError):
        measure_and_print(measurement, OutputOptions(results=tmp_path), each=fail)
    assert ended
