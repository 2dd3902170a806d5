"""The tally of `benchmarks.studies.judgements`: MJX and Warp beside C, model by model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.studies import tally_file
from mjbench.host.isolate import Channel
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import models, reference_run, workload
from mjbench.simulation.accelerated_judgement import EngineJudgement
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.verification.records import VariantRecord


@dataclass(frozen=True, kw_only=True)
class JudgedModel:
    """One path on one model.

    Attributes:
      package: that the model is of; `shipped` for those of mjbench.
      judgement: None where the path did not come so far; then `detail` says why.
    """

    package: str
    model: str
    path: str
    status: Status
    detail: str
    judgement: EngineJudgement | None
    trace_s: float | None
    compile_s: float | None
    versions: Mapping[str, str] | None

    @classmethod
    def of(cls, package: str, record: VariantRecord) -> "JudgedModel":
        """Return what a path's record says."""
        return cls(
            package=package,
            model=record.model,
            path=record.path,
            status=record.status,
            detail=record.detail,
            judgement=record.judgement,
            trace_s=record.trace_s,
            compile_s=record.compile_s,
            versions=record.versions,
        )


@dataclass(frozen=True)
class JudgementTally:
    """What was judged, with how many simulations and steps."""

    mujoco: str
    nbatch: int
    nstep: int
    rows: Sequence[JudgedModel]

    def with_row(self, row: JudgedModel) -> "JudgementTally":
        """Return the tally with one more row, instead of an earlier one of the same."""
        key = (row.package, row.model, row.path)
        rows = [r for r in self.rows if (r.package, r.model, r.path) != key]
        rows = sorted([*rows, row], key=lambda r: (r.package != "shipped", r.model, r.path))
        return replace(self, rows=tuple(rows))


def save_states(source: ModelSource, file: Path, nbatch: int, nstep: int, channel: Channel) -> None:
    """Write the workload of a model to a file; runs in a child, as a model may crash MuJoCo."""
    sample = workload.make(models.load(source), nbatch, nstep)
    save_workload(sample, reference_run.observe(sample).peaks, file)


def load(file: Path) -> JudgementTally:
    """Return the tally that a file holds."""
    return tally_file.load(file, JudgementTally, "judgements")
