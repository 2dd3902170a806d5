"""From lines of a node's run file to sections of the run set: which cell is complete, and how.

Commands that measure several cells append a record for each; its cell is then complete. What
`compare` says of a model are several records, which are complete when the command has ended.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.history import release_ratios
from benchmarks.history.release_ratios import StepRatioRecord
from mjbench.comparison import records as comparison_records
from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.counts.records import InstructionsRecord
from mjbench.errors import Failure
from mjbench.host.machine import Machine
from mjbench.host.neighbours import Disturbance
from mjbench.paired.metrics import Metric
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.records import TargetRow, VerdictRecord
from mjbench.status import Status, exit_code
from mjbench.store import run_writer, runs
from mjbench.store.run_set import RunSection
from mjbench.store.runs import Record, Run, RunHeader
from mjbench.sweep.cells import Cell, CellKind

# A name for the lines of a node, in messages about them.
_SOURCE = Path("what the node measured")
# From the worst status to the best: that of a cell is the worst of its records.
_WORST_FIRST = (
    Status.INTERRUPTED,
    Status.CRASHED,
    Status.TIMEOUT,
    Status.FAILED,
    Status.INPUT,
    Status.DISAGREES,
    Status.OK,
    Status.UNAVAILABLE,
)
# The records that say how something ended.
_Timed = VerdictRecord | StepRatioRecord | InstructionsRecord
_Ended = _Timed | ModelRecord | MeasurementRecord | RaceRecord
# The records of the commands that a sweep runs, by their `type`.
_RECORD_TYPES: Mapping[str, type] = {
    **comparison_records.RECORD_TYPES,
    **{
        record.record_type: record
        for record in (RaceRecord, VerdictRecord, StepRatioRecord, InstructionsRecord, Disturbance)
    },
}


@dataclass(frozen=True)
class CellOutcome:
    """How a cell ended: the worst status of its records; `seconds` is None if they do not say."""

    status: Status
    detail: str = ""
    seconds: float | None = None


@dataclass(frozen=True)
class CellResult:
    """A cell that is complete."""

    cell: Cell
    section: RunSection

    @property
    def outcome(self) -> CellOutcome:
        return outcome(self.section.run)


def outcome(run: Run) -> CellOutcome:
    ended = [record for record in run.records if isinstance(record, _Ended)]
    if not ended:
        return CellOutcome(Status.FAILED, "there is no result")
    worst = min(ended, key=lambda record: _WORST_FIRST.index(record.status))
    seconds = [record.seconds for record in ended if isinstance(record, _Timed)]
    return CellOutcome(worst.status, worst.detail, sum(seconds) if seconds else None)


class Collector:
    """Takes the lines of one command, and gives its cells in their order as they are complete.

    Lines that are not those of a run file raise InputError.
    """

    def __init__(self, cells: Sequence[Cell]):
        self.missing = list(cells)
        self._lines: list[bytes] = []
        self._complete: dict[Cell, CellResult] = {}

    def add(self, lines: Sequence[bytes]) -> list[CellResult]:
        for line in lines:
            self._lines.append(line)
            if len(self._lines) == 1 or not self.missing or self._is_comparison():
                continue
            section = self._section(self._lines[0], line)
            (record,) = section.run.records
            self._complete |= {
                cell: _named(cell, section) for cell in self.missing if _is_answer(record, cell)
            }
        return self._take()

    def end(self, code: int) -> list[CellResult]:
        """Return the cells that the end of the command completes.

        A command that ended otherwise than its records say has not written all of them.
        """
        if not self.missing or not self._is_comparison() or not self._lines:
            return []
        section = self._section(*self._lines)
        statuses = [r.status for r in section.run.records if isinstance(r, _Ended)]
        is_whole = section.run.of_type(ModelRecord) and exit_code(statuses) == code
        if is_whole and Status.INTERRUPTED not in statuses:
            self._complete = {cell: _named(cell, section) for cell in self.missing}
        return self._take()

    def _is_comparison(self) -> bool:
        return self.missing[0].kind == CellKind.COMPARE

    def _take(self) -> list[CellResult]:
        taken = []
        while self.missing and self.missing[0] in self._complete:
            taken.append(self._complete[self.missing.pop(0)])
        return taken

    def _section(self, *lines: bytes) -> RunSection:
        run = runs.parse(_SOURCE, lines, _RECORD_TYPES, may_be_torn=False)
        return RunSection("", run, lines)


def _named(cell: Cell, section: RunSection) -> CellResult:
    return CellResult(cell, RunSection(cell.key, section.run, section.lines))


def _is_answer(record: Record, cell: Cell) -> bool:
    match record:
        case VerdictRecord() if cell.kind == CellKind.VERSIONS:
            names = (record.model, record.path, record.old, record.new)
            is_same = names == (cell.model, cell.path, cell.baseline, cell.release)
            is_answer = is_same and record.metric == cell.metric
        case StepRatioRecord() | InstructionsRecord():
            is_ratio = isinstance(record, StepRatioRecord)
            kind = CellKind.HISTORY if is_ratio else CellKind.INSTRUCTIONS
            given = (kind, record.model, record.release)
            is_answer = given == (cell.kind, cell.model, cell.release)
        case _:
            return False
    return is_answer and record.status != Status.INTERRUPTED


def failed(cell: Cell, failure: Failure, machine: Machine) -> CellResult:
    """Return the result of a cell that has none, because its command never wrote one."""
    began = datetime.now(UTC).isoformat(timespec="seconds")
    header = RunHeader(runs.SCHEMA, cell.kind.value, machine, {}, began=began)
    record = _ended_record(cell, failure)
    lines = tuple(run_writer.line_of(item).encode() for item in (header, record))
    return CellResult(cell, RunSection(cell.key, Run(header, (record,)), lines))


def _ended_record(cell: Cell, failure: Failure) -> _Timed | ModelRecord:
    model, release, status, detail = cell.model, cell.release, failure.status, failure.detail
    match cell.kind:
        case CellKind.VERSIONS:
            versions = cell.baseline, release
            return VerdictRecord(
                model=model,
                path=cell.path,
                old=cell.baseline,
                new=release,
                sides=[TargetRow(version, model, cell.path, {}, {}) for version in versions],
                metric=cell.metric or Metric.TIME,
                status=status,
                detail=detail,
            )
        case CellKind.INSTRUCTIONS:
            return InstructionsRecord(model=model, release=release, status=status, detail=detail)
        case CellKind.HISTORY:
            reference = release_ratios.REFERENCE
            return StepRatioRecord(
                model=model,
                release=release,
                build="",
                reference=reference,
                status=status,
                detail=detail,
            )
        case CellKind.COMPARE:
            return ModelRecord(model=model, status=status, detail=detail)
