"""What `mjbench tune` measures: settings of models."""

from collections.abc import Sequence
from dataclasses import replace

from mjbench.commands.tune import setting_names
from mjbench.commands.tune.c_search import PARTS, Advance, CSearch, SearchPlan
from mjbench.commands.tune.measurements import SILENCE_S, CMeasurements
from mjbench.commands.tune.options import TuneOptions
from mjbench.commands.tune.result import Effect, Limits, TuneRecord
from mjbench.measuring.timing import Progress
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, finished, in_turn, input_files
from mjbench.simulation.models import ModelSource


def measurement(sources: Sequence[ModelSource], options: TuneOptions) -> Measurement:
    """Return the search for faster settings of each model; InputError for an unknown setting."""
    starts = options.starts
    budget = options.budget
    plan = SearchPlan(
        options.seed,
        starts,
        budget.each_s,
        Limits(options.max_error, options.max_change),
        Effect(options.allow),
        options.hold,
        setting_names.chosen(options.only or (), options.skip or ()),
    )

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        with WorkerPool() as pool:

            def tuned(source: ModelSource, budget_s: float, on_progress: Progress) -> Item:
                def advance(done: int, text: str, share: float) -> None:
                    on_progress(text, (done + share) / PARTS)

                search = replace(plan, budget_s=budget_s)
                return Item([tune(pool, source, search, options.time_limit_s, advance)])

            yield from in_turn(sources, tuned, budget, earlier, observer)

    names = [source.name for source in sources]
    arguments = {"models": names, "plan": plan, "budget_s": options.budget_s}
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
