"""Compare paths again in fresh processes, for `mjbench compare` and `mjbench.compare`."""

import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from typing import TypeVar

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.instrument.runs import Record
from mjbench.paired import contest
from mjbench.paired.confirmation import ComparedSizes, ConfirmationRecord, compare_again
from mjbench.paired.contest import ContestRecord
from mjbench.paired.worker_pool import WorkerPool
from mjbench.report.advice import Pairing, clock_pairing, contest_groups
from mjbench.report.results import ModelResults
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

_Record = TypeVar("_Record", ConfirmationRecord, ContestRecord)


class Confirmation:
    """Compares again what advice needs, in processes that are started when the first is needed.

    Attributes:
      is_interrupted: whether the user stopped it.
    """

    def __init__(self, store: Callable[[Record], object], closing: contextlib.ExitStack):
        """Pass records to `store`; `closing` ends the processes."""
        self.is_interrupted = False
        self._store, self._closing = store, closing
        self._pool: WorkerPool | None = None

    def complete(
        self, source: ModelSource, plan: ComparisonPlan, results: ModelResults
    ) -> ModelResults:
        """Return the results of a model with the comparisons in fresh processes that advice needs.

        Args:
          source: the model.
          plan: of the comparison that gave the results.
          results: of that comparison.
        """
        if pairing := clock_pairing(results):
            record = self.compare(source, plan, pairing, results.compared_sizes)
            results = dataclasses.replace(results, confirmations=(*results.confirmations, record))
        if not self.is_interrupted and (groups := contest_groups(results)):
            held = self.contest(source, plan, groups, results.compared_sizes)
            results = dataclasses.replace(results, contest=held)
        return results

    def compare(
        self,
        source: ModelSource,
        plan: ComparisonPlan,
        pairing: Pairing,
        sizes: ComparedSizes,
    ) -> ConfirmationRecord:
        """Return the record of a comparison, which is stored, too.

        Args:
          source: the model.
          plan: of the comparison that the two paths come from.
          pairing: the two paths.
          sizes: of that comparison.
        """
        variants = pairing.baseline, pairing.candidate
        pool = self._workers()
        return self._stored(compare_again(pool, source, plan, variants, sizes, pairing.min_effect))

    def contest(
        self,
        source: ModelSource,
        plan: ComparisonPlan,
        groups: Sequence[Sequence[Variant]],
        sizes: ComparedSizes,
    ) -> ContestRecord:
        """Return the record of a contest, which is stored, too.

        Args:
          source: the model.
          plan: of the comparison that the paths come from.
          groups: of paths that compete with each other.
          sizes: of that comparison.
        """
        return self._stored(contest.run(self._workers(), source, plan, groups, sizes))

    def _workers(self) -> WorkerPool:
        if self._pool is None:
            self._pool = self._closing.enter_context(WorkerPool())
        return self._pool

    def _stored(self, record: _Record) -> _Record:
        self._store(record)
        self.is_interrupted = record.status == Status.INTERRUPTED
        return record
