"""The documents that `--json` writes, and the records of run files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjbench.comparison import records as comparison_records
from mjbench.comparison.listing import ListedModel
from mjbench.comparison.planning_run import PlanningRow
from mjbench.counts.records import (
    ExplainRecord,
    InstructionsRecord,
)
from mjbench.environment.records import EnvironmentRecord
from mjbench.instrument.conditions import Condition
from mjbench.instrument.machine import Machine
from mjbench.instrument.runs import SCHEMA
from mjbench.loop.latency import LatencyRow
from mjbench.loop.overhead import OverheadRow
from mjbench.loop.profile import ProfileRow
from mjbench.paired.placement_spread import SpreadRecord
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.paired.selfcheck_records import SelfcheckRow, TrialRecord
from mjbench.program.records import ProgramRow
from mjbench.releases import speed_history
from mjbench.releases.catalogue import ReleaseRow
from mjbench.releases.release_ratios import OperationRatioRecord, RatioRecord, StepRatioRecord
from mjbench.report.advice import Advice, ClockAdvice, advise, advise_clock
from mjbench.report.crossovers import Crossover, crossovers
from mjbench.report.doctor import NoiseRow
from mjbench.report.lint import LintDocument
from mjbench.report.listings import PathRow
from mjbench.report.results import ModelResults, PathResult
from mjbench.report.run_differences import RunDifference
from mjbench.report.thread_advice import ThreadAdvice, advise_threads
from mjbench.report.work_crossovers import WorkCrossover, work_crossovers
from mjbench.status import Status
from mjbench.tuning.records import TuneRecord
from mjbench.web.records import WebRecord

# The records of a run file by their `type`.
RECORD_TYPES: Mapping[str, type] = {
    **comparison_records.RECORD_TYPES,
    RaceRecord.record_type: RaceRecord,
    OverheadRow.record_type: OverheadRow,
    ProfileRow.record_type: ProfileRow,
    ProgramRow.record_type: ProgramRow,
    LatencyRow.record_type: LatencyRow,
    PlanningRow.record_type: PlanningRow,
    EnvironmentRecord.record_type: EnvironmentRecord,
    VerdictRecord.record_type: VerdictRecord,
    TrialRecord.record_type: TrialRecord,
    SpreadRecord.record_type: SpreadRecord,
    StepRatioRecord.record_type: StepRatioRecord,
    OperationRatioRecord.record_type: OperationRatioRecord,
    ExplainRecord.record_type: ExplainRecord,
    InstructionsRecord.record_type: InstructionsRecord,
    TuneRecord.record_type: TuneRecord,
    WebRecord.record_type: WebRecord,
}


@dataclass(frozen=True, kw_only=True)
class CompareDocument:
    """What `mjbench compare --json` writes."""

    schema: int = 2
    machine: Machine
    results: Sequence[PathResult]
    advice: Sequence[Advice]
    clock: Sequence[ClockAdvice]
    crossovers: Sequence[Crossover]
    work_crossovers: Sequence[WorkCrossover]
    threads: Sequence[ThreadAdvice] = ()

    @classmethod
    def of(cls, machine: Machine, models: Sequence[ModelResults]) -> "CompareDocument":
        """Return the document of a comparison's results."""
        results = [result for model_results in models for result in model_results.results]
        return cls(
            machine=machine,
            results=results,
            advice=[advice for model_results in models for advice in advise(model_results)],
            clock=[clock for m in models if (clock := advise_clock(m)) is not None],
            crossovers=crossovers(results),
            work_crossovers=work_crossovers(results),
            threads=[advice for m in models for advice in advise_threads(m)],
        )


@dataclass(frozen=True, kw_only=True)
class DiffDocument:
    """What `mjbench diff --json` writes."""

    schema: int = SCHEMA
    results: Sequence[RunDifference]


@dataclass(frozen=True)
class ModelRow:
    """A model and its facts, which are None where it could not be loaded (see `ModelFacts`)."""

    model: str
    status: Status
    detail: str = ""
    nq: int | None = None
    nv: int | None = None
    nu: int | None = None
    na: int | None = None
    contacts: int | None = None
    constraints: int | None = None
    timestep: float | None = None
    integrator: str | None = None
    solver: str | None = None
    cone: str | None = None
    can_fall: bool | None = None
    has_clock: bool | None = None

    @classmethod
    def of(cls, listed: ListedModel) -> "ModelRow":
        """Return the row of a listed model."""
        facts = vars(listed.facts) if listed.facts else {}
        return cls(listed.model, listed.status, listed.detail, **facts)


@dataclass(frozen=True, kw_only=True)
class ModelsDocument:
    """What `mjbench models --json` writes."""

    schema: int = SCHEMA
    models: Sequence[ModelRow]


@dataclass(frozen=True, kw_only=True)
class PathsDocument:
    """What `mjbench paths --json` writes."""

    schema: int = SCHEMA
    paths: Sequence[PathRow]


@dataclass(frozen=True, kw_only=True)
class VerdictDocument:
    """What `mjbench versions --json` and `mjbench ab --json` write."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[VerdictRow]


@dataclass(frozen=True, kw_only=True)
class SelfcheckDocument:
    """What `mjbench selfcheck --json` writes; `busy`: whether a core was kept busy meanwhile."""

    schema: int = SCHEMA
    machine: Machine
    busy: bool | None
    results: Sequence[SelfcheckRow]


@dataclass(frozen=True, kw_only=True)
class HistoryDocument:
    """What `mjbench history measure --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[StepRatioRecord]
    operations: Sequence[OperationRatioRecord]

    @classmethod
    def of(cls, machine: Machine, records: Sequence[RatioRecord]) -> "HistoryDocument":
        """Return the document of records of both kinds, in the order of their releases."""
        records = speed_history.in_order_of_release(records)
        steps = [record for record in records if isinstance(record, StepRatioRecord)]
        operations = [record for record in records if isinstance(record, OperationRatioRecord)]
        return cls(machine=machine, results=steps, operations=operations)


@dataclass(frozen=True, kw_only=True)
class PlacementDocument:
    """What `mjbench placement --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[SpreadRecord]


@dataclass(frozen=True, kw_only=True)
class OverheadDocument:
    """What `mjbench overhead --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[OverheadRow]


@dataclass(frozen=True, kw_only=True)
class ProfileDocument:
    """What `mjbench profile --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[ProfileRow]


@dataclass(frozen=True, kw_only=True)
class ProgramDocument:
    """What `mjbench run --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[ProgramRow]


@dataclass(frozen=True, kw_only=True)
class LatencyDocument:
    """What `mjbench latency --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[LatencyRow]


@dataclass(frozen=True, kw_only=True)
class PlanDocument:
    """What `mjbench plan --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[PlanningRow]


@dataclass(frozen=True, kw_only=True)
class EnvDocument:
    """What `mjbench env --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[EnvironmentRecord]


@dataclass(frozen=True, kw_only=True)
class TuneDocument:
    """What `mjbench tune --json` writes."""

    schema: int = 2
    machine: Machine
    results: Sequence[TuneRecord]


@dataclass(frozen=True, kw_only=True)
class WebDocument:
    """What `mjbench web --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[WebRecord]


@dataclass(frozen=True, kw_only=True)
class DoctorDocument:
    """What `mjbench doctor --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    conditions: Sequence[Condition]
    noise: NoiseRow


@dataclass(frozen=True, kw_only=True)
class InstructionsDocument:
    """What `mjbench instructions --json` writes."""

    schema: int = SCHEMA
    results: Sequence[InstructionsRecord]


@dataclass(frozen=True, kw_only=True)
class ExplainDocument:
    """What `mjbench explain --json` writes."""

    schema: int = SCHEMA
    results: Sequence[ExplainRecord]


@dataclass(frozen=True, kw_only=True)
class ReleasesDocument:
    """What `mjbench releases --json` writes."""

    schema: int = SCHEMA
    releases: Sequence[ReleaseRow]


# The document of each command that takes `--json`; `show` has those of others, and of a run set its
# own.
DOCUMENTS: Mapping[str, type] = {
    "compare": CompareDocument,
    "diff": DiffDocument,
    "models": ModelsDocument,
    "paths": PathsDocument,
    "versions": VerdictDocument,
    "ab": VerdictDocument,
    "selfcheck": SelfcheckDocument,
    "history": HistoryDocument,
    "placement": PlacementDocument,
    "instructions": InstructionsDocument,
    "explain": ExplainDocument,
    "overhead": OverheadDocument,
    "profile": ProfileDocument,
    "run": ProgramDocument,
    "tune": TuneDocument,
    "latency": LatencyDocument,
    "plan": PlanDocument,
    "env": EnvDocument,
    "web": WebDocument,
    "doctor": DoctorDocument,
    "lint": LintDocument,
    "releases": ReleasesDocument,
}
