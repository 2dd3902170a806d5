"""Search the history of the user's code for the commits that changed the time of a function."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench.paired import bisect_search, function_sides, function_verdict
from mjbench.paired.bisect_records import BisectMeasured, VersionKind, VersionRow
from mjbench.paired.bisect_search import SearchRange, VersionMeasurer
from mjbench.paired.function_sides import RevisionComparison
from mjbench.paired.records import VerdictRecord
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.revisions import Commit
from mjbench.status import Status
from mjbench.store.runs import Record


@dataclass(frozen=True)
class _RevisionMeasurer(VersionMeasurer):
    """Measures commits of the user's code: its one function has the text of the last commit."""

    comparison: RevisionComparison
    commits: Sequence[Commit]
    plan: VerdictPlan
    on_phase: Callable[[str], None]

    def decide(self, baseline: int, candidate: int) -> VerdictRecord:
        """See `VersionMeasurer.decide`; raises KeyboardInterrupt, too."""
        pair = self._pair(baseline, candidate)
        self.on_phase(f"comparing {pair.baseline.name} and {pair.candidate.name}")
        with WorkerPool() as pool:
            (targets,) = function_sides.check_out(pool, pair)
            record = function_verdict.decide(pool, targets, self.plan)
        if record.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        return record

    def log_ratios(self, baseline: int, candidate: int, count: int) -> Sequence[float]:
        with WorkerPool() as pool:
            (targets,) = function_sides.check_out(pool, self._pair(baseline, candidate))
            return function_verdict.launch_log_ratios(pool, targets, count)

    def _pair(self, baseline: int, candidate: int) -> RevisionComparison:
        ends = self.comparison
        old, new = (
            ends.baseline if number == 0 else self.commits[number - 1].revision
            for number in (baseline, candidate)
        )
        return replace(ends, baseline=old, candidate=new)


def search(
    comparison: RevisionComparison,
    plan: VerdictPlan,
    on_phase: Callable[[str], None] = lambda text: None,
    earlier: Sequence[Record] = (),
) -> Iterator[BisectMeasured]:
    """Yield what is measured, and which commits changed the time of a function.

    Raises:
      InputError: the candidate does not come after the baseline.
    """
    repository, candidate = comparison.repository, comparison.candidate
    commits = repository.history(comparison.baseline, candidate)
    (function,) = comparison.functions
    if function.file is not None:  # all commits are measured by one benchmark
        text = repository.text(candidate, function.file)
        comparison = replace(comparison, functions=[replace(function, content=text)])
    searched = SearchRange(
        function.text,
        VersionKind.COMMIT,
        comparison.baseline.name,
        candidate.name,
        [VersionRow(n, each.commit, each.subject) for n, each in enumerate(commits, 1)],
    )
    measurer = _RevisionMeasurer(comparison, commits, plan, on_phase)
    return bisect_search.search(measurer, searched, plan.min_effect, earlier)
