"""What `mjbench tune` measures: settings of models."""

from collections.abc import Sequence

from mjbench.api.session import Item, Items, Measurement, Observer, finished, in_turn, input_files
from mjbench.commands.tune import knobs
from mjbench.commands.tune.c_search import PARTS, Advance, CSearch, SearchPlan
from mjbench.commands.tune.measurements import SILENCE_S, CMeasurements
from mjbench.commands.tune.result import Effect, TuneRecord
from mjbench.measuring.timing import Progress
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results.runs import Record
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan


def measurement(
    sources: Sequence[ModelSource],
    only: str | None,
    skip: Sequence[str] | None,
    max_error: float | None,
    budget_s: float,
    hold: int,
    seed: int,
    starts: StartPlan,
    limit_s: float,
) -> Measurement:
    effect, skipped = Effect(only or Effect.APPROXIMATE), knobs.known(skip or ())
    plan = SearchPlan(seed, starts, budget_s, max_error, effect, hold, skipped)

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        with WorkerPool() as pool:

            def tuned(source: ModelSource, on_progress: Progress) -> Item:
                def advance(done: int, text: str, share: float) -> None:
                    on_progress(text, (done + share) / PARTS)

                return Item([tune(pool, source, plan, limit_s, advance)])

            yield from in_turn(sources, tuned, earlier, observer)

    arguments = {"models": [source.name for source in sources], "plan": plan}
    return Measurement("tune", arguments, input_files(sources, [], starts), items, finished)


def tune(
    pool: WorkerPool,
    source: ModelSource,
    plan: SearchPlan,
    limit_s: float = SILENCE_S,
    advance: Advance = lambda done, text, share: None,
) -> TuneRecord:
    """Return what a search for faster settings of a model came to, however it ended.

    Args:
      limit_s: seconds of silence after which a process is killed.
    """
    measurements = CMeasurements(pool, source, plan.starts, plan.hold, limit_s)
    return CSearch(TuneRecord(model=source.name), plan, measurements, advance).result()
