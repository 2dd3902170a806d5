"""What `mjbench tune` measures: settings of models, and a copy of a model with the best of them."""

from collections.abc import Sequence
from pathlib import Path

from mjbench.api.session import Item, Items, Measurement, Observer, finished, in_turn, input_files
from mjbench.errors import InputError
from mjbench.measuring.timing import Progress
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan
from mjbench.store.runs import Record, Run
from mjbench.tuning import edited_model, knobs
from mjbench.tuning.accelerated_attempts import EngineMeasurements
from mjbench.tuning.accelerated_search import EngineSearch
from mjbench.tuning.c_search import CSearch
from mjbench.tuning.measurements import SILENCE_S, CMeasurements
from mjbench.tuning.records import Batch, Effect, TuneRecord
from mjbench.tuning.search_base import PARTS, Advance, SearchPlan
from mjbench.tuning.settings import NBATCH, edits_of


def measurement(
    sources: Sequence[ModelSource],
    engine: str,
    nbatch: int | None,
    only: str | None,
    skip: Sequence[str] | None,
    max_error: float | None,
    budget_s: float,
    hold: int,
    seed: int,
    starts: StartPlan,
    limit_s: float,
    copy: Path | None = None,
) -> Measurement:
    """Return the search; it begins only where `copy`, if given, can be written later."""
    if engine == "c" and nbatch is not None:
        raise InputError("--nbatch needs --engine mjx or warp")
    if engine != "c" and only is not None:
        raise InputError("--only works with --engine c; use --max-error instead")
    if engine != "c" and skip is not None:
        raise InputError("--skip works with --engine c")
    effect, skipped = Effect(only or Effect.APPROXIMATE), knobs.known(skip or ())
    plan = SearchPlan(
        seed, starts, budget_s, max_error, effect, hold, skipped, engine, nbatch or NBATCH
    )
    if copy is not None:
        if len(sources) > 1:
            raise InputError("--write takes one model")
        edited_model.check_source(sources[0])

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        if copy is not None:
            edited_model.copy_in_child(sources[0], None, copy, limit_s)
        with WorkerPool() as pool:

            def tuned(source: ModelSource, on_progress: Progress) -> Item:
                def advance(done: int, text: str, share: float) -> None:
                    on_progress(text, (done + share) / PARTS)

                return Item([tune(pool, source, plan, limit_s, advance)])

            yield from in_turn(sources, tuned, earlier, observer)

    arguments = {"models": [source.name for source in sources], "plan": plan}
    return Measurement("tune", arguments, input_files(sources, [], starts), items, finished)


def write_best(run: Run, source: ModelSource, copy: Path, limit_s: float) -> bool:
    """Write a copy of a model's file with the best settings; return whether there are any."""
    (record,) = run.of_type(TuneRecord)
    best = record.best()
    edits = edits_of(best.settings) if best else []
    if edits:
        edited_model.copy_in_child(source, edits, copy, limit_s)
    return bool(edits)


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
