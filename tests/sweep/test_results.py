"""Lines of a run file become sections: each cell with what was measured of it, and nothing else."""

from dataclasses import replace
from pathlib import Path

import pytest
from example_races import compared, raced
from example_records import measurement, model_record
from sweep_examples import MACHINE, count_cell, header, line, verdict, verdict_cell

from benchmarks.history.release_ratios import StepRatioRecord
from mjbench.counts.records import InstructionsRecord
from mjbench.errors import Failure, InputError
from mjbench.host.neighbours import Disturbance
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import runs
from mjbench.store.run_set import RunSection, RunSetFile, read
from mjbench.sweep import results
from mjbench.sweep.cells import Cell, CellKind
from mjbench.sweep.results import Collector

CELLS = [verdict_cell("pile", release) for release in ("3.5.0", "4.0.0")]
DISTURBANCE = Disturbance(["compare"])
COMPARE = Cell(CellKind.COMPARE, "m")


def test_each_record_completes_its_cell_with_the_header_of_its_run() -> None:
    collector = Collector(CELLS)
    assert collector.add([header()]) == []
    first, second = (line(verdict(cell)) for cell in CELLS)
    (result,) = collector.add([first])
    assert result.cell == CELLS[0]
    assert result.section.cell == CELLS[0].key
    assert result.section.lines == (header(), first)
    assert [result.cell for result in collector.add([second])] == [CELLS[1]]
    assert collector.end(0) == []


def test_a_section_can_be_read_back(tmp_path: Path) -> None:
    path = tmp_path / "set.jsonl"
    (result,) = Collector(CELLS).add([header(), line(verdict(CELLS[0]))])
    file = RunSetFile.create(path)
    file.append(result.section)
    file.close()
    (section,) = read(path, RECORD_TYPES).sections
    assert (section.cell, section.run) == (result.section.cell, result.section.run)
    assert results.outcome(section.run) == result.outcome


@pytest.mark.parametrize(
    "record",
    [
        verdict(verdict_cell("pile", "3.9.0")),
        verdict(verdict_cell("humanoid")),
        verdict(CELLS[0], Status.INTERRUPTED),
        InstructionsRecord(model="pile", release="3.5.0"),
        raced(model="pile"),
    ],
)
def test_what_was_not_asked_for_or_interrupted_completes_nothing(record: runs.Record) -> None:
    assert Collector(CELLS).add([header(), line(record)]) == []


def test_counts_and_ratios_complete_the_cell_of_their_model_and_release() -> None:
    counted = count_cell("pile", "3.5.0")
    timed = Cell(CellKind.HISTORY, "pile", "3.5.0")
    count = InstructionsRecord(model="pile", release="3.5.0", seconds=3.0)
    ratio = StepRatioRecord(
        model="pile", release="3.5.0", build="b", reference="4.0.0", status=Status.OK
    )
    for cell, record in ((counted, count), (timed, ratio)):
        (result,) = Collector([cell]).add([header(), line(record)])
        assert result.cell == cell


def test_what_disturbed_a_command_is_no_result_of_a_cell() -> None:
    collector = Collector(CELLS)
    lines = [header(), line(verdict(CELLS[0])), line(DISTURBANCE)]
    (result,) = collector.add(lines)
    assert result.section.lines == tuple(lines[:2])


def test_a_comparison_is_complete_when_its_command_has_ended() -> None:
    lines = [header("compare"), *map(line, [*compared(raced()), DISTURBANCE])]
    collector = Collector([COMPARE])
    assert collector.add(lines) == []
    (result,) = collector.end(0)
    assert result.section.lines == tuple(lines)
    assert result.outcome.status == Status.OK


@pytest.mark.parametrize(
    ("statuses", "code", "is_complete"),
    [
        ((Status.OK, Status.OK), 0, True),
        ((Status.OK, Status.DISAGREES), 1, True),
        ((Status.OK, Status.CRASHED), 3, True),
        ((Status.INPUT,), 2, True),
        ((Status.OK, Status.OK), 3, False),  # the disk was full before all was written
        ((Status.OK, Status.OK), -9, False),
        ((Status.OK,), 130, False),
        ((Status.INTERRUPTED,), 130, False),
        ((Status.OK, Status.OK, Status.CRASHED), 3, True),
        ((), 3, False),
    ],
)
def test_a_comparison_that_ended_otherwise_than_its_records_say_is_not_complete(
    statuses: tuple[Status, ...], code: int, is_complete: bool
) -> None:
    collector = Collector([COMPARE])
    records = [model_record(status=s) for s in statuses[:1]]
    records += [measurement(status=s) for s in statuses[1:2]]  # type: ignore[misc]
    records += [replace(raced(), status=s) for s in statuses[2:]]  # type: ignore[misc]
    collector.add([header("compare"), *map(line, records)])
    assert len(collector.end(code)) == is_complete


def test_cells_come_in_their_order() -> None:
    collector = Collector(CELLS)
    first, second = (line(verdict(cell)) for cell in CELLS)
    assert collector.add([header(), second]) == []
    assert collector.missing == CELLS
    assert [result.cell for result in collector.add([first])] == CELLS
    assert collector.missing == []
    assert collector.add([second]) == []


def test_without_a_line_nothing_is_complete() -> None:
    assert Collector([COMPARE]).end(0) == []
    assert Collector(CELLS).end(0) == []


@pytest.mark.parametrize("other", [b"no JSON\n", b"{}\n", b'{"type": "verdict"}\n'])
def test_other_lines_are_refused(other: bytes) -> None:
    with pytest.raises(InputError, match="what the node measured"):
        Collector(CELLS).add([header(), other])


def test_a_comparison_is_as_bad_as_the_worst_of_its_paths() -> None:
    collector = Collector([COMPARE])
    bad = measurement(path="threads", status=Status.CRASHED, detail="killed by signal 11")
    unable = measurement(path="mjx", status=Status.UNAVAILABLE)
    collector.add([header("compare"), *map(line, (model_record(), measurement(), bad, unable))])
    (result,) = collector.end(3)
    assert (result.outcome.status, result.outcome.detail) == (
        Status.CRASHED,
        "killed by signal 11",
    )


@pytest.mark.parametrize(
    "cell",
    [
        CELLS[0],
        count_cell("pile"),
        Cell(CellKind.HISTORY, "pile", "3.5.0"),
        Cell(CellKind.COMPARE, "pile"),
    ],
)
def test_a_cell_without_a_result_has_how_it_failed_in_its_place(cell: Cell) -> None:
    result = results.failed(cell, Failure(Status.CRASHED, "its worker was killed"), MACHINE)
    assert result.section.cell == cell.key
    assert (result.outcome.status, result.outcome.detail) == (
        Status.CRASHED,
        "its worker was killed",
    )
    written = runs.parse(results._SOURCE, result.section.lines, RECORD_TYPES)
    assert runs.to_json(written) == runs.to_json(result.section.run)
    if cell.kind != CellKind.COMPARE:
        again = Collector([cell]).add(result.section.lines)
        assert [one.cell for one in again] == [cell]


def test_a_section_without_any_result_counts_as_failed() -> None:
    run = runs.parse(results._SOURCE, [header()], RECORD_TYPES)
    assert results.outcome(RunSection("", run, (header(),)).run).status == Status.FAILED
