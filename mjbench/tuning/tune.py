"""Find faster settings for a model: what `mjbench tune` does."""

import dataclasses

from mjbench.errors import MjbenchError, failure_of
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.tuning import survey
from mjbench.tuning.attempts import SILENCE_S
from mjbench.tuning.measurements import OnThisMachine
from mjbench.tuning.records import TuneRecord
from mjbench.tuning.search import Advance, Search, SearchPlan, ended
from mjbench.tuning.survey import SurveyRequest


def tune(
    pool: WorkerPool,
    source: ModelSource,
    plan: SearchPlan,
    limit_s: float = SILENCE_S,
    advance: Advance = lambda done, text, share: None,
) -> TuneRecord:
    """Return what a search for faster settings of a model came to.

    A model that cannot be stepped, and Ctrl-C, are the record's status; it holds what was measured.

    Args:
      limit_s: seconds of silence after which a process is killed.
    """
    try:
        advance(0, "what there is to try", 0.0)
        seen = survey.survey(SurveyRequest(source, plan.seed, plan.starts, plan.hold), limit_s)
        shares = survey.stages(source, plan.starts, limit_s)
    except MjbenchError as error:
        failure = failure_of(error)
        detail = failure.detail.removeprefix(f"{source.name}: ")
        return TuneRecord(model=source.name, status=failure.status, detail=detail)
    except KeyboardInterrupt:
        return TuneRecord(model=source.name, status=Status.INTERRUPTED)
    measurements = OnThisMachine(pool, source, plan.starts, plan.hold, limit_s)
    settings = [each for each in seen.settings if each.knob not in plan.skip]
    search = Search(source.name, settings, plan, measurements, advance)
    record = ended(search.run, search.record)
    return dataclasses.replace(record, meshes=seen.meshes, stages=shares)
