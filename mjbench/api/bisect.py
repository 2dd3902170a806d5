"""What `mjbench bisect` measures: commits of the user's code."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace

from mjbench.api.session import Item, Measurement, Observer, pinning_notes
from mjbench.paired import revision_bisect
from mjbench.paired.bisect_records import BisectTrial
from mjbench.paired.revision_sides import RevisionComparison
from mjbench.paired.verdict import VerdictPlan
from mjbench.store.runs import Record
from mjbench.units import percent_change, short_commit

# Commits that are measured in a search, about, for its progress.
_USUAL_TRIALS = 8


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
