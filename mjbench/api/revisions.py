"""What `mjbench ab rev=… rev=…` and `mjbench bisect` measure: functions in revisions."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace

from mjbench.api.session import Item, Measurement, Observer, pinning_notes
from mjbench.paired import function_verdict, revision_bisect, revision_sides
from mjbench.paired.bisect_records import BisectTrial
from mjbench.paired.function_pair import FunctionTargets
from mjbench.paired.judgement import Judgement
from mjbench.paired.records import VerdictRecord, finished
from mjbench.paired.revision_sides import RevisionComparison
from mjbench.paired.verdict import VerdictPlan, completed_share, sides_key
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status
from mjbench.store.runs import Record
from mjbench.units import percent_change, short_commit

# Commits that are measured in a search, about, for its progress.
_USUAL_TRIALS = 8


def revision_verdicts(comparison: RevisionComparison, plan: VerdictPlan) -> Measurement:
    plan = replace(plan, family=len(comparison.functions), as_shipped=True)
    revisions = comparison.baseline, comparison.candidate

    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        done = {sides_key(record.sides) for record in finished(earlier)}
        with WorkerPool() as pool:
            all_targets = revision_sides.check_out(pool, comparison, observer.begin)
            for number, targets in enumerate(all_targets):
                if sides_key([target.row() for target in targets]) in done:
                    continue
                record = _decide(pool, targets, plan, observer, number / len(all_targets))
                yield Item([record])
                if record.status == Status.INTERRUPTED:
                    return

    return Measurement(
        "ab",
        {
            **asdict(plan),
            "revisions": [asdict(revision) for revision in revisions],
            "functions": [function.text for function in comparison.functions],
        },
        comparison.files,
        measure,
        finished,
        [*comparison.notes, *pinning_notes()],
    )


def _decide(
    pool: WorkerPool, targets: FunctionTargets, plan: VerdictPlan, observer: Observer, share: float
) -> VerdictRecord:
    """Return the verdict on one function; `share` of all work is done before it."""
    name = targets[1].function
    observer(name, share)

    def on_launch(judgement: Judgement) -> None:
        text = f"{name} {percent_change(judgement.ratio.estimate)} %"
        observer(text, share + completed_share(judgement.launches) / plan.family)

    return function_verdict.decide(pool, targets, plan, on_launch)


def bisection(comparison: RevisionComparison, plan: VerdictPlan) -> Measurement:
    plan = replace(plan, as_shipped=True)
    (function,) = comparison.functions

    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        trials: list[BisectTrial] = []

        def on_trial(trial: BisectTrial) -> None:
            trials.append(trial)
            change = "cannot be measured"
            if trial.ratio is not None:
                change = f"{percent_change(trial.ratio)} %"
            text = f"{short_commit(trial.commit.commit)} {change}"
            observer(text, len(trials) / (len(trials) + _USUAL_TRIALS))

        yield Item([revision_bisect.search(comparison, plan, observer.begin, on_trial)])

    return Measurement(
        "bisect",
        {
            **asdict(plan),
            "revisions": [asdict(each) for each in (comparison.baseline, comparison.candidate)],
            "function": function.text,
        },
        comparison.files,
        measure,
        lambda records: (),
        pinning_notes(),
    )
