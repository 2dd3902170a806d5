"""Compare paths again in fresh processes, for `mjbench compare` and `mjbench.compare`."""

import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from typing import TypeVar

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.instrument import progress
from mjbench.instrument.progress import Progress
from mjbench.instrument.runs import Record
from mjbench.paired import contest
from mjbench.paired.confirmation import ComparedSizes, ConfirmationRecord, compare_again
from mjbench.paired.contest import ContestRecord
from mjbench.paired.judgement import Judgement
from mjbench.paired.worker_pool import WorkerPool
from mjbench.report.advice import Pairing, clock_pairing, contest_groups
from mjbench.report.results import ModelResults
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

_Record = TypeVar("_Record", ConfirmationRecord, ContestRecord)
# After as many launches, the bar of a comparison of two paths is half full.
_HALFWAY_LAUNCHES = 8
# Share of the bar of a model's comparisons that the one of MuJoCo's timer has.
_CLOCK_SHARE = 0.3


class Confirmation:
    """Compares again what advice needs, in processes that are started when the first is needed."""

    def __init__(self, store: Callable[[Record], object], closing: contextlib.ExitStack):
        """Pass records to `store`; `closing` ends the processes."""
        self.is_interrupted = False
        self._store, self._closing = store, closing
        self._pool: WorkerPool | None = None

    def complete(
        self,
        source: ModelSource,
        plan: ComparisonPlan,
        results: ModelResults,
        on_progress: Progress = progress.ignore,
    ) -> ModelResults:
        """Return the results of a model with the comparisons in fresh processes that advice needs.

        Args:
          plan: of the comparison that gave the results.
          results: of that comparison.
          on_progress: called before the first launch and after each.
        """
        if pairing := clock_pairing(results):
            on_clock = progress.part_of(on_progress, 0.0, _CLOCK_SHARE)
            record = self.compare(source, plan, pairing, results.compared_sizes, on_clock)
            results = dataclasses.replace(results, confirmations=(*results.confirmations, record))
        if not self.is_interrupted and (groups := contest_groups(results)):
            on_contest = progress.part_of(on_progress, _CLOCK_SHARE, 1.0)
            held = self.contest(source, plan, groups, results.compared_sizes, on_contest)
            results = dataclasses.replace(results, contest=held)
        return results

    def compare(
        self,
        source: ModelSource,
        plan: ComparisonPlan,
        pairing: Pairing,
        sizes: ComparedSizes,
        on_progress: Progress = progress.ignore,
    ) -> ConfirmationRecord:
        """Return the record of a comparison, which is stored, too.

        Args:
          plan: of the comparison that the two paths come from.
          sizes: of that comparison.
          on_progress: called before the first launch and after each.
        """
        name = f"{source.name}: {pairing.candidate} in fresh processes"

        def on_launch(judgement: Judgement) -> None:
            on_progress(name, 1 - 1 / (1 + judgement.launches / _HALFWAY_LAUNCHES))

        on_progress(name, 0.0)
        variants, pool = (pairing.baseline, pairing.candidate), self._workers()
        return self._stored(
            compare_again(pool, source, plan, variants, sizes, pairing.min_effect, on_launch)
        )

    def contest(
        self,
        source: ModelSource,
        plan: ComparisonPlan,
        groups: Sequence[Sequence[Variant]],
        sizes: ComparedSizes,
        on_progress: Progress = progress.ignore,
    ) -> ContestRecord:
        """Return the record of a contest, which is stored, too.

        Args:
          plan: of the comparison that the paths come from.
          groups: of paths that compete with each other.
          sizes: of that comparison.
          on_progress: called before the first launch and after each.
        """
        name = f"{source.name}: fastest paths in fresh processes"

        def on_launch(launches: int, share: float) -> None:
            on_progress(f"{name}, launch {launches}", share)

        on_progress(name, 0.0)
        pool = self._workers()
        return self._stored(contest.run(pool, source, plan, groups, sizes, on_launch=on_launch))

    def _workers(self) -> WorkerPool:
        if self._pool is None:
            self._pool = self._closing.enter_context(WorkerPool())
        return self._pool

    def _stored(self, record: _Record) -> _Record:
        self._store(record)
        self.is_interrupted = record.status == Status.INTERRUPTED
        return record
