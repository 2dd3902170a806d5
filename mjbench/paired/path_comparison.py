"""Compare the ways of stepping one model: agreement in one child, then a race in fresh processes.

`compare_model` yields what is known after each launch of the race, so that a table can be shown
early. Accelerated paths, which compile first, are measured after the race.
"""

import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench import paths
from mjbench.comparison.compare import ModelChildren
from mjbench.comparison.messages import ModelFiles
from mjbench.comparison.plan import WITHOUT_TIMER, ComparisonPlan, Variant
from mjbench.comparison.records import MeasurementRecord, ModelRecord, of_model
from mjbench.host import neighbours
from mjbench.host.machine import ProcessorTime
from mjbench.measuring import progress
from mjbench.measuring.progress import Progress
from mjbench.paired.race import RaceBudget, race
from mjbench.paired.race_launches import RaceLaunches
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource
from mjbench.status import FINISHED, Status
from mjbench.store.runs import Record

# Share of a model's progress that verification stands for; the race is the rest.
_VERIFICATION_SHARE = 0.2


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


def enter(model: ModelRecord, variants: Sequence[Variant]) -> RaceRecord:
    """Return the race of variants, the plain loop first, on a model, before its first launch."""
    assert model.block_steps is not None, "the paths were verified"
    slow = [i for i, each in enumerate(variants) if paths.find(each.path).starts_slowly]
    compete = [i for i, each in enumerate(variants) if each != WITHOUT_TIMER and i not in slow]
    return RaceRecord(
        model=model.model,
        nbatch_asked=model.nbatch_asked,
        steps=model.block_steps,
        variants=variants,
        groups=[compete, [i for i in compete if paths.find(variants[i].path).closed_loop]],
        slow=slow,
    )


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


def compare_model(
    pool: WorkerPool,
    source: ModelSource,
    plan: ComparisonPlan,
    on_progress: Progress = progress.ignore,
    on_phase: Callable[[str], None] = lambda text: None,
    clock: Callable[[], float] = time.monotonic,
) -> Generator[ModelComparison, None, None]:
    """Compare the paths of a plan; yield what is known after each launch, and at the end.

    Ctrl-C, which may be thrown into it, ends it: what is known then comes last.

    Args:
      on_phase: called with a line where a phase begins: agreement, the race, and each path that
        compiles.
    """
    comparison = _PathComparison(pool, source, plan, on_progress, on_phase, clock)
    try:
        yield from comparison.run()
    except KeyboardInterrupt:
        comparison.children.ended = None
    yield comparison.snapshot(is_over=True)


class _PathComparison:
    def __init__(
        self,
        pool: WorkerPool,
        source: ModelSource,
        plan: ComparisonPlan,
        on_progress: Progress,
        on_phase: Callable[[str], None],
        clock: Callable[[], float],
    ):
        self._pool, self._plan, self._name = pool, plan, source.name
        self._on_progress, self._on_phase, self._clock = on_progress, on_phase, clock
        self._begin_s, self._processor_time = clock(), ProcessorTime.now()
        self.children = ModelChildren(source, plan, ModelFiles.in_folder(pool.new_folder()))
        self._race: RaceRecord | None = None

    def run(self) -> Iterator[ModelComparison]:
        children = self.children
        self._on_phase(f"{self._name}: checking agreement")
        ended = children.verify(self._show_verifying)
        verified_s = self._clock() - self._begin_s
        if ended.status != Status.OK:
            return
        yield from self._run_race(verified_s)
        if self._race is not None and self._race.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        for index in self._plan.accelerated:
            phase = f"{self._name}: {self._plan.variants[index]}"
            self._on_phase(phase)
            self._on_progress(phase, 1.0)
            children.run_accelerated(index)
            yield self.snapshot()

    def snapshot(self, is_over: bool = False) -> ModelComparison:
        timed: list[int] = []
        if self._race is not None:
            positions = {i for launch in self._race.launches for i in launch.variants}
            timed = [self._plan.variants.index(self._race.variants[i]) for i in positions]
        measurements = self.children.measurements(timed, is_over)
        return ModelComparison(self.children.model_record(), measurements, self._race)

    def _run_race(self, verified_s: float) -> Iterator[ModelComparison]:
        agreeing = self.children.agreeing
        if 0 not in agreeing:  # the plain loop
            return
        variants = [self._plan.variants[i] for i in agreeing]
        launches = RaceLaunches(self._pool, self.children, variants)
        entered = enter(self.children.model_record(), variants)
        budget = RaceBudget(self._begin_s + self._plan.budget_s, self._clock)
        # a launch takes about as long as the agreement check: each runs every path a few times
        expected_s = max(1.0, verified_s, budget.left_s())
        racing = f"racing {len(variants)} paths, about {expected_s:.0f} s"
        if budget.left_s() < verified_s:
            racing += ": one launch takes longer than is left of the budget"
        phase = racing if len(variants) > 1 else "timing the plain loop"
        self._on_phase(f"{self._name}: {phase}")
        for record in race(entered, launches, budget):
            self._race = self._with_disturbance(record)
            for unable in record.unable:
                index = agreeing[unable.variant]
                self.children.revise(index, unable.status, unable.detail)
            self._show_racing(record)
            yield self.snapshot()

    def _with_disturbance(self, record: RaceRecord) -> RaceRecord:
        others = [each for each in neighbours.measuring_now() if each.pid != os.getpid()]
        earlier = self._race.neighbours if self._race is not None else ()
        names = sorted({*earlier, *(each.command for each in others)})
        return replace(
            record,
            stolen_share=ProcessorTime.now().stolen_since(self._processor_time),
            neighbours=names,
        )

    def _show_verifying(self) -> None:
        share = _VERIFICATION_SHARE * self.children.share_verified
        self._on_progress(f"{self._name}: do all paths agree?", share)

    def _show_racing(self, record: RaceRecord) -> None:
        spent = (self._clock() - self._begin_s) / self._plan.budget_s
        left = len(record.launches[-1].variants) if record.launches else len(record.variants)
        text = f"{self._name}: launch {len(record.launches)}, {left} paths left"
        self._on_progress(text, min(1.0, max(_VERIFICATION_SHARE, spent)))
