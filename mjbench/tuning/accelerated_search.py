"""Search settings that make a batched step of MJX or Warp faster, and transfer to C as well.

1. Every setting is tried alone, beside the present ones, in one process.
2. Those that are faster, and err no more than allowed, are tried together: the fastest of each
   knob, two, then three, and so on.
3. The fastest of all are measured again, in fresh processes, from starts and with controls that
   the search has not seen. What that does not confirm is withdrawn.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from mjbench.measuring import stats
from mjbench.tuning.accelerated_attempts import EngineMeasurements
from mjbench.tuning.pareto_front import error_of, time_ratio_of
from mjbench.tuning.records import (
    CONFIDENCE,
    Attempt,
    Batch,
    BatchFacts,
    Recommendation,
    TunedProgram,
    allowed_error,
    fresh_ratio,
    log_ratio,
    saves_time,
)
from mjbench.tuning.search_base import LEAST_GAIN, Search, too_far
from mjbench.tuning.settings import Setting, Settings, label

# Shares of the budget after which no setting is tried alone, and none together.
ALONE_SHARE, TOGETHER_SHARE = 0.5, 0.65
# Settings that are looked at again, and fresh processes for them: as many as there is time for.
FINALISTS, LEAST_PROCESSES, PROCESSES = 2, 4, 8


class EngineSearch(Search):
    """A search for settings of MJX or Warp; all effects are allowed."""

    _measure: EngineMeasurements
    _facts: BatchFacts
    _present: TunedProgram | None = None

    def _measure_present(self) -> None:
        self._advance(0, "the present settings in C", 0.0)
        self._facts = self._measure.baseline(self._plan.trials(0))
        self._set(batch=Batch(self._plan.nbatch, self._facts))

    def _try_settings(self) -> list[Attempt]:
        alone = [(setting,) for setting in self._facts.settings]
        self._try(1, alone, ALONE_SHARE)
        self._set(untried=len(alone) - len(self._record.attempts))
        limit = self._limit(self._facts, self._present)
        together = combinations(_helpful(self._record.attempts, limit))
        if together and self._left_s(TOGETHER_SHARE) > 0:
            self._try(2, together, TOGETHER_SHARE)
        return _helpful(self._record.attempts, limit)[:FINALISTS]

    def _try(self, part: int, settings: Sequence[Settings], share: float) -> None:
        count = 0

        def note(attempt: Attempt) -> None:
            nonlocal count
            count += 1
            self._note(attempt)
            self._advance(part, label(attempt.settings), count / len(settings))

        self._advance(part, label(settings[0]) if settings else "", 0.0)
        program = self._measure.launch(settings, note, self._left_s(share))
        self._present = self._present or program
        self._set(batch=Batch(self._plan.nbatch, self._facts, self._present))

    def _limit(self, facts: BatchFacts, present: TunedProgram | None) -> float:
        assert present is not None and present.error is not None, "it was measured"
        return allowed_error(self._plan.max_error, present.error.share, facts.rounding.share)

    def _second_look(self, attempts: Sequence[Attempt]) -> None:
        plan, settings = self._plan, [each.settings for each in attempts]
        self._advance(3, "C from new starts", 0.0)
        ncontrol = self._facts.horizon_ncontrol
        new = self._measure.baseline(plan.trials(1, ncontrol, ncontrol))
        launches: list[list[Attempt]] = []

        def launch(has_errors: bool) -> TunedProgram:
            launches.append([])
            return self._measure.launch(settings, launches[-1].append, has_errors=has_errors)

        begin_s = self._clock()
        limit = self._limit(new, launch(has_errors=True))
        affordable = int(self._left_s(1.0) / max(self._clock() - begin_s, 1e-9))
        more = min(max(affordable, LEAST_PROCESSES - 1), PROCESSES - 1)
        for number in range(more):
            self._advance(3, "fresh processes", (number + 1) / (more + 1))
            launch(has_errors=False)
        for i, first in enumerate(attempts):
            self._judge(first, [each[i] for each in launches], limit)
        front = sorted(self._record.front, key=lambda each: len(each.settings))
        simplest = sorted(self._simplest(front), key=lambda each: each.ratio.estimate)
        self._set(front=simplest)

    def _judge(self, first: Attempt, launches: Sequence[Attempt], limit: float) -> None:
        """Recommend or withdraw settings, by all processes of the second look."""
        settings, second = first.settings, launches[0]
        failed = next((each.detail for each in launches if each.samples is None), None)
        if failed is not None:
            self._withdraw(settings, failed)
            return
        assert second.error is not None, "it was measured"
        samples = [each.samples for each in launches if each.samples]
        ratio = fresh_ratio(samples)
        if second.error.share > limit:
            self._withdraw(settings, f"transfer {too_far(second.error.share, limit)}")
        elif not saves_time(ratio):
            self._withdraw(settings, "not certainly faster in fresh processes")
        else:
            self._recommend(first, second, ratio, samples)

    def _simplest(self, front: Sequence[Recommendation]) -> Iterator[Recommendation]:
        """Yield recommendations, without those that only add settings of no certain gain."""
        for number, each in enumerate(front):
            labels = {setting.label for setting in each.settings}
            simpler = [
                other
                for other in front[:number]
                if {setting.label for setting in other.settings} < labels
            ]
            slower = [other for other in simpler if not is_faster(each, other)]
            if slower:
                reason = f"not certainly faster than {label(slower[0].settings)} alone"
                self._withdraw(each.settings, reason)
            else:
                yield each

    def _left_s(self, share: float) -> float:
        return share * self._plan.budget_s - (self._clock() - self._begin_s)


def combinations(helpful: Sequence[Attempt]) -> list[Settings]:
    by_knob: dict[str, Setting] = {}
    for attempt in helpful:
        (setting,) = attempt.settings
        by_knob.setdefault(setting.knob, setting)
    fastest = tuple(by_knob.values())
    return [fastest[:count] for count in range(2, len(fastest) + 1)]


def is_faster(one: Recommendation, other: Recommendation) -> bool:
    pairs = zip(one.samples, other.samples, strict=True)
    logs = [log_ratio(mine) - log_ratio(theirs) for mine, theirs in pairs]
    return float(np.mean(logs)) + stats.mean_half_width(logs, CONFIDENCE) < 0


def _helpful(attempts: Sequence[Attempt], limit: float) -> list[Attempt]:
    """Return the attempts that seem faster and err no more than allowed, the fastest first."""
    helpful = [
        each
        for each in attempts
        if each.error is not None
        and error_of(each) <= limit
        and time_ratio_of(each) <= 1 - LEAST_GAIN
    ]
    return sorted(helpful, key=time_ratio_of)
