"""Find faster settings for a model: what `mjbench tune` does."""

from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource
from mjbench.tuning.accelerated_attempts import EngineMeasurements
from mjbench.tuning.accelerated_search import EngineSearch
from mjbench.tuning.c_search import CSearch
from mjbench.tuning.measurements import SILENCE_S, CMeasurements
from mjbench.tuning.records import Batch, TuneRecord
from mjbench.tuning.search_base import Advance, SearchPlan


def tune(
    pool: WorkerPool,
    source: ModelSource,
    plan: SearchPlan,
    limit_s: float = SILENCE_S,
    advance: Advance = lambda done, text, share: None,
) -> TuneRecord:
    """Return what a search for faster settings of a model came to, however it ended.

    Args:
      limit_s: seconds of silence after which a process is killed; compilers get more.
    """
    if plan.engine == "c":
        in_c = CMeasurements(pool, source, plan.starts, plan.hold, limit_s)
        return CSearch(TuneRecord(model=source.name), plan, in_c, advance).result()
    record = TuneRecord(model=source.name, engine=plan.engine, batch=Batch(plan.nbatch))
    batched = EngineMeasurements(pool, source, plan.engine, plan.nbatch, limit_s)
    return EngineSearch(record, plan, batched, advance).result()
