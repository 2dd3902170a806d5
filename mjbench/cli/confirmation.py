"""Compare paths again in fresh processes, for `compare` and `compare --scaling`."""

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

from mjbench.cli.context import RunContext
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.comparison.plan import ComparisonPlan, Variant
    from mjbench.paired.confirmation import ComparedSizes, ConfirmationRecord
    from mjbench.paired.contest import ContestRecord
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.advice import Pairing
    from mjbench.simulation.models import ModelSource

_Record = TypeVar("_Record", "ConfirmationRecord", "ContestRecord")


class Confirmation:
    """Compares again what advice needs, in processes that are started when the first is needed.

    Attributes:
      is_interrupted: whether the user stopped it.
    """

    def __init__(self, run: RunContext, closing: contextlib.ExitStack):
        """Store records in a run; `closing` ends the processes."""
        self.is_interrupted = False
        self._run, self._closing = run, closing
        self._pool: WorkerPool | None = None

    def compare(
        self,
        source: "ModelSource",
        plan: "ComparisonPlan",
        pairing: "Pairing",
        sizes: "ComparedSizes",
    ) -> "ConfirmationRecord":
        """Return the record of a comparison, which the run file has then, too.

        Args:
          source: the model.
          plan: of the comparison that the two paths come from.
          pairing: the two paths.
          sizes: of that comparison.
        """
        from mjbench.paired.confirmation import compare_again

        variants = pairing.baseline, pairing.candidate
        pool = self._workers()
        return self._stored(compare_again(pool, source, plan, variants, sizes, pairing.min_effect))

    def contest(
        self,
        source: "ModelSource",
        plan: "ComparisonPlan",
        groups: "Sequence[Sequence[Variant]]",
        sizes: "ComparedSizes",
    ) -> "ContestRecord":
        """Return the record of a contest, which the run file has then, too.

        Args:
          source: the model.
          plan: of the comparison that the paths come from.
          groups: of paths that compete with each other.
          sizes: of that comparison.
        """
        from mjbench.paired import contest

        return self._stored(contest.run(self._workers(), source, plan, groups, sizes))

    def _workers(self) -> "WorkerPool":
        from mjbench.paired.worker_pool import WorkerPool

        if self._pool is None:
            self._pool = self._closing.enter_context(WorkerPool())
        return self._pool

    def _stored(self, record: _Record) -> _Record:
        self._run.record(record)
        self.is_interrupted = record.status == Status.INTERRUPTED
        return record
