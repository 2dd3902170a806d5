"""The kinds of results: what a run file stores of each, and what each comes to.

What is listed here is all that `show`, `--json`, `mjbench.load` and the results of
`import mjbench` know of a kind.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.commands.checkup import ranking as checkup_ranking
from mjbench.commands.checkup import show as checkup
from mjbench.commands.checkup.result import CheckedPart
from mjbench.commands.compare import show as comparison
from mjbench.commands.compare.results import derive_all
from mjbench.commands.env import show as environment
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.latency import show as latency
from mjbench.commands.latency.measure import LatencyRow
from mjbench.commands.profile import habit_costs
from mjbench.commands.profile import show as profile
from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.commands.profile.measure import ProfileRow
from mjbench.commands.run import show as program
from mjbench.commands.run.result import ProgramRow
from mjbench.commands.show import documents
from mjbench.commands.tune import show as tuning
from mjbench.commands.tune.result import TuneRecord
from mjbench.commands.versions import bisect_show as bisect
from mjbench.commands.versions import show as verdicts
from mjbench.commands.versions.bisect import BisectComparison, BisectRecord
from mjbench.counts import show as counts
from mjbench.counts.records import ExplainRecord, InstructionsRecord
from mjbench.host.disturbance import Disturbance
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.records import VerdictRecord
from mjbench.results.content import Section, after_disturbances
from mjbench.results.json_form import MachineResultsDocument, ResultsDocument
from mjbench.results.runs import Record, Run
from mjbench.verification.records import ModelRecord, VariantRecord


@dataclass(frozen=True)
class Kind:
    """A kind of results: what of a run file it is of, and what becomes of a run.

    Attributes:
      commands: those whose `--json` writes its document.
      sections: what a run comes to; what disturbed it comes first.
      rows: of the flat table (`mjbench.load`).
    """

    commands: tuple[str, ...]
    records: tuple[type[Record], ...]
    document: Callable[[Run], object]
    sections: Callable[[Run], Iterable[Section]]
    rows: Callable[[Run], Iterable[object]]


def _kind(
    record: type[Record],
    sections: Callable[[Sequence[Any]], Iterable[Section]],
    *commands: str,
    has_machine: bool = True,
    rows: Callable[[Any], Iterable[object]] | None = None,
) -> Kind:
    """Return a kind whose document has the records themselves as results.

    Each record is a row of the flat table, or has `rows`.
    """

    def document(run: Run) -> object:
        results = run.of_type(record)
        if not has_machine:
            return ResultsDocument(results=results)
        return MachineResultsDocument(machine=run.header.machine, results=results)

    def flat_rows(run: Run) -> Iterator[object]:
        for each in run.of_type(record):
            yield from [each] if rows is None else rows(each)

    return Kind(
        commands,
        (record,),
        document,
        lambda run: after_disturbances(run, sections(run.of_type(record))),
        flat_rows,
    )


CHECKUP = Kind(
    ("checkup",),
    (CheckedPart,),
    checkup.CheckupDocument.of,
    lambda run: after_disturbances(run, checkup.sections(run)),
    checkup_ranking.items,
)
COMPARE = Kind(
    ("compare",),
    (ModelRecord, VariantRecord, RaceRecord),
    lambda run: documents.CompareDocument.of(run.header.machine, derive_all(run.records)),
    lambda run: comparison.sections(derive_all(run.records)),  # races say what disturbed them
    lambda run: comparison.flat_rows(derive_all(run.records)),
)
OVERHEAD = _kind(OverheadRow, habit_costs.sections, "overhead")
PROFILE = _kind(ProfileRow, profile.sections, "profile")
PROGRAM = _kind(ProgramRow, program.sections, "run", rows=program.program_rows)
LATENCY = _kind(LatencyRow, latency.sections, "latency")
ENVIRONMENT = _kind(EnvironmentRecord, environment.sections, "env")
VERDICT = Kind(
    ("versions", "ab"),
    (VerdictRecord,),
    lambda run: MachineResultsDocument(
        machine=run.header.machine, results=verdicts.verdict_rows(run)
    ),
    verdicts.sections,
    verdicts.verdict_rows,
)
BISECT = Kind(
    ("bisect",),
    (BisectRecord, BisectComparison),
    lambda run: MachineResultsDocument(
        machine=run.header.machine, results=run.of_type(BisectRecord)
    ),
    lambda run: after_disturbances(run, bisect.sections(run.records)),
    lambda run: run.of_type(BisectRecord),
)
EXPLAIN = _kind(ExplainRecord, counts.explanations, "explain", has_machine=False)
INSTRUCTIONS = _kind(InstructionsRecord, counts.sections, "instructions", has_machine=False)
TUNE = _kind(TuneRecord, tuning.sections, "tune", rows=tuning.rows)


# A run of a check-up has records of several kinds; its own comes first.
KINDS: Sequence[Kind] = (
    *(CHECKUP, COMPARE, OVERHEAD, PROFILE, PROGRAM, LATENCY, ENVIRONMENT, VERDICT),
    *(BISECT, EXPLAIN, INSTRUCTIONS, TUNE),
)

# The records of a run file by their `type`.
RECORD_TYPES: Mapping[str, type[Any]] = {
    **{record.record_type: record for kind in KINDS for record in kind.records},
    Disturbance.record_type: Disturbance,
}


def kinds_of(run: Run) -> list[Kind]:
    """Return the kinds that a run has records of: one, or none of an empty run."""
    types = {type(record) for record in run.records}
    return [kind for kind in KINDS if types.intersection(kind.records)]


def kind_of(run: Run) -> Kind:
    """Return the kind of a run: of its records, or of an empty run of its command."""
    of_command = [kind for kind in KINDS if run.header.command in kind.commands]
    return [*kinds_of(run), *of_command, COMPARE][0]
