"""Compare releases by the instructions of their steps, model by model."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mjbench.counts import explain
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.paired import verdict
from mjbench.paired.records import VerdictRecord
from mjbench.releases.installs import ReleaseSpec
from mjbench.simulation.models import ModelSource


@dataclass(frozen=True)
class InstructionComparison:
    """What is counted: models in an old release, and in new ones."""

    baseline: ReleaseSpec
    candidates: Sequence[ReleaseSpec]
    sources: Sequence[ModelSource]
    min_effect: float


def verdicts(
    comparison: InstructionComparison,
    counter: InstructionCounter,
    stored: Sequence[VerdictRecord] = (),
    on_candidate: Callable[[int], None] = lambda number: None,
    on_record: Callable[[VerdictRecord], None] = lambda record: None,
) -> Iterator[VerdictRecord]:
    """Yield the verdict on each model in each new release.

    Args:
      stored: verdicts that need not be measured again.
      on_candidate: called with the position of each new release before it is counted.
      on_record: called with each verdict that was measured, before it is yielded.
    """
    baselines: dict[str, ModelCount] = {}
    for number, candidate in enumerate(comparison.candidates):
        on_candidate(number)
        finished = {r.model: r for r in stored if r.sides[1].build == candidate.key}
        yield from finished.values()
        missing = [source for source in comparison.sources if source.name not in finished]
        new = [source for source in missing if source.name not in baselines]
        for count in counter.count(comparison.baseline, new) if new else ():
            baselines[count.model] = count
        for count in counter.count(candidate, missing) if missing else ():
            row = explain.verdict_row(baselines[count.model], count, comparison.min_effect)
            record = verdict.record_of(row)
            on_record(record)
            yield record
