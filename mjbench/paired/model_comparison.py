"""What is known of one model at one size, and what a continued run need not measure again."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.comparison.plan import ComparisonPlan
from mjbench.comparison.records import MeasurementRecord, ModelRecord, of_model
from mjbench.paired.race_record import RaceRecord
from mjbench.simulation.models import ModelSource
from mjbench.status import FINISHED, Status
from mjbench.store.runs import Record


@dataclass(frozen=True)
class ModelComparison:
    """What is known of one model at one size.

    Attributes:
      race: of the paths that run C and agree; None before it, and where there was none.
    """

    model: ModelRecord
    measurements: tuple[MeasurementRecord, ...]
    race: RaceRecord | None = None

    @property
    def is_interrupted(self) -> bool:
        return self.model.status == Status.INTERRUPTED

    @property
    def records(self) -> list[ModelRecord | MeasurementRecord | RaceRecord]:
        return [self.model, *self.measurements, *([self.race] if self.race else [])]


def stored(
    source: ModelSource, plan: ComparisonPlan, records: Sequence[object]
) -> ModelComparison | None:
    """Return the comparison of a model at the plan's size from records of a run; None without."""
    for record in records:
        if not isinstance(record, ModelRecord):
            continue
        if (record.model, record.nbatch_asked) == (source.name, plan.nbatch):
            return _of_model(record, records)
    return None


def _of_model(model: ModelRecord, records: Sequence[object]) -> ModelComparison:
    measurements = of_model(MeasurementRecord, model, records)
    return ModelComparison(model, tuple(measurements), race_of(model, records))


def race_of(model: ModelRecord, records: Sequence[object]) -> RaceRecord | None:
    return next(iter(of_model(RaceRecord, model, records)), None)


def finished(records: Sequence[Record], nvariant: int) -> list[Record]:
    """Return the records of models that are not measured again: all ended, none by a failure."""
    done: list[Record] = []
    for model in records:
        if not isinstance(model, ModelRecord):
            continue
        known = _of_model(model, records)
        raced = [m for m in known.measurements if m.status == Status.OK and not m.samples_s]
        if raced and known.race is None:  # the last line of the file was cut short
            continue
        is_finished = all(each.status in FINISHED for each in known.records)
        if len(known.measurements) == nvariant and is_finished:
            done += known.records
    return done
