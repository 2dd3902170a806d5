"""Compare paths again in fresh processes, for `compare` and `compare --scaling`."""

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

from mjbench.cli.context import RunContext
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.comparison.compare import Progress
    from mjbench.comparison.plan import ComparisonPlan, Variant
    from mjbench.paired.confirmation import ComparedSizes, ConfirmationRecord
    from mjbench.paired.contest import ContestRecord
    from mjbench.paired.judgement import Judgement
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.advice import Pairing
    from mjbench.simulation.models import ModelSource

_Record = TypeVar("_Record", "ConfirmationRecord", "ContestRecord")
# After as many launches, the bar of a comparison of two paths is half full.
_HALFWAY_LAUNCHES = 8


def no_progress(name: str, share: float) -> None:
    """Show nothing."""


def part_of(on_progress: "Progress", begin: float, end: float) -> "Progress":
    """Return what shows the progress of a part of the work as that of the whole.

    Args:
      on_progress: shows that of the whole.
      begin: share of the whole that is done before the part.
      end: share that is done after it.
    """
    return lambda name, share: on_progress(name, begin + (end - begin) * share)


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
        on_progress: "Progress" = no_progress,
    ) -> "ConfirmationRecord":
        """Return the record of a comparison, which the run file has then, too.

        Args:
          source: the model.
          plan: of the comparison that the two paths come from.
          pairing: the two paths.
          sizes: of that comparison.
          on_progress: called before the first launch and after each.
        """
        from mjbench.paired.confirmation import compare_again

        name = f"{source.name}: {pairing.candidate} in fresh processes"

        def on_launch(judgement: "Judgement") -> None:
            on_progress(name, 1 - 1 / (1 + judgement.launches / _HALFWAY_LAUNCHES))

        on_progress(name, 0.0)
        variants, pool = (pairing.baseline, pairing.candidate), self._workers()
        return self._stored(
            compare_again(pool, source, plan, variants, sizes, pairing.min_effect, on_launch)
        )

    def contest(
        self,
        source: "ModelSource",
        plan: "ComparisonPlan",
        groups: "Sequence[Sequence[Variant]]",
        sizes: "ComparedSizes",
        on_progress: "Progress" = no_progress,
    ) -> "ContestRecord":
        """Return the record of a contest, which the run file has then, too.

        Args:
          source: the model.
          plan: of the comparison that the paths come from.
          groups: of paths that compete with each other.
          sizes: of that comparison.
          on_progress: called before the first launch and after each.
        """
        from mjbench.paired import contest

        name = f"{source.name}: fastest paths in fresh processes"

        def on_launch(launches: int, share: float) -> None:
            on_progress(f"{name}, launch {launches}", share)

        on_progress(name, 0.0)
        pool = self._workers()
        return self._stored(contest.run(pool, source, plan, groups, sizes, on_launch=on_launch))

    def _workers(self) -> "WorkerPool":
        from mjbench.paired.worker_pool import WorkerPool

        if self._pool is None:
            self._pool = self._closing.enter_context(WorkerPool())
        return self._pool

    def _stored(self, record: _Record) -> _Record:
        self._run.record(record)
        self.is_interrupted = record.status == Status.INTERRUPTED
        return record
