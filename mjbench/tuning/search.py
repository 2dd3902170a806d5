"""Search settings that make a model faster: each alone, then together, then a second look.

`Search` is what searches share. That of C has these parts; that of MJX and Warp is in
`accelerated_search`.

1. Every setting is tried alone, in a process of its own; those that seem faster are compared with
   the present settings in fresh processes.
2. Those that are faster are combined. Combinations are tried on few runs first; the better half
   goes on to more runs (successive halving: Jamieson and Talwalkar, AISTATS 2016).
3. The front, on which no setting is both faster and nearer to the reference than another, is
   measured again from starts and with controls that the search has not seen. What that does not
   confirm is withdrawn.
"""

import abc
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

from mjbench.errors import MjbenchError, failure_of
from mjbench.measuring.ratio import Ratio
from mjbench.paired.records import LaunchRow, VerdictRecord
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning import fronts
from mjbench.tuning.fronts import FRONT, effect_of, error_of, is_allowed
from mjbench.tuning.measurements import QUADS, CMeasurements, saves_time
from mjbench.tuning.records import (
    Attempt,
    Effect,
    Recommendation,
    TuneRecord,
    Withdrawal,
    allowed_error,
)
from mjbench.tuning.reference import HOLD, Present, TrialPlan
from mjbench.tuning.settings import Setting, label

# A setting that saves less than this, by its attempt, is not looked at again.
LEAST_GAIN = 0.01
# An error of more than this share of the motion is no simulation of the model any more.
MOST_ERROR = 0.5
# Seconds that a comparison in fresh processes may take: of one setting, and in the second look.
SINGLE_S, FINAL_S = 10.0, 15.0
# Seconds that the second look at each recommendation takes, at least.
LEAST_FINAL_S = 12.0
# Shares of the time before the second look after which no further setting is attempted alone, and
# none is compared alone.
ATTEMPTS_SHARE, SINGLES_SHARE = 0.5, 0.8
# Combinations that are tried; runs and quads of each in the first rung.
COMBINATIONS, RUNG_NRUN, RUNG_QUADS = 32, 8, 12
# Of those, so many are tried from all starts.
LAST_RUNG = 2 * FRONT
# Called with how many parts of the search are done, what goes on, and a share of 0.
Advance = Callable[[int, str, float], None]
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4

Measurements = TypeVar("Measurements")


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      budget_s: seconds after which nothing is begun but the second look.
      max_error: the largest error allowed, as a share of the motion; None for the present one.
      engine: `c`, `mjx` or `warp`; the latter two allow all effects, and skip nothing.
      nbatch: simulations of a batched step of those two.
    """

    seed: int = 0
    starts: StartPlan = field(default_factory=StartPlan)
    budget_s: float = 300.0
    max_error: float | None = None
    only: Effect = Effect.APPROXIMATE
    hold: int = HOLD
    skip: tuple[str, ...] = ()
    engine: str = "c"
    nbatch: int = 1

    def trials(
        self, look: int, ncontrol: int | None = None, horizon_ncontrol: int | None = None
    ) -> TrialPlan:
        """Return the starts and controls of a look.

        Args:
          look: 0 for the search, 1 for the second look, more for further ones, which have the
            lengths that the search had.
        """
        return TrialPlan(self.seed + look, self.starts, self.hold, ncontrol, horizon_ncontrol)


class Search(abc.ABC, Generic[Measurements]):
    """One search for settings of one model; `record` says what came of it, at any time."""

    def __init__(
        self,
        record: TuneRecord,
        plan: SearchPlan,
        measurements: Measurements,
        advance: Advance = lambda done, text, share: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Measure nothing yet."""
        self._measure = measurements
        self._record = replace(record, seed=plan.seed, max_error=plan.max_error, only=plan.only)
        self._plan, self._advance, self._clock = plan, advance, clock
        self._begin_s = clock()

    def result(self) -> TuneRecord:
        """Search; return what came of it, however it ended."""
        try:
            self.run()
        except MjbenchError as error:
            failure = failure_of(error)
            detail = failure.detail.removeprefix(f"{self._record.model}: ")
            return self.record(failure.status, detail)
        except KeyboardInterrupt:
            return self.record(Status.INTERRUPTED)
        return self.record()

    def run(self) -> None:
        """Search; after an error or Ctrl-C, `record` has what was measured."""
        self._measure_present()
        if attempts := self._try_settings():
            self._second_look(attempts)

    def record(self, status: Status = Status.OK, detail: str = "") -> TuneRecord:
        """Return what was measured so far."""
        return replace(self._record, status=status, detail=detail, seconds=self._spent_s())

    @abc.abstractmethod
    def _measure_present(self) -> None:
        """See what there is to try, and measure the present settings."""

    @abc.abstractmethod
    def _try_settings(self) -> Sequence[Attempt]:
        """Try settings alone and together; return those that are worth a second look."""

    @abc.abstractmethod
    def _second_look(self, attempts: Sequence[Attempt]) -> None:
        """Recommend settings that further starts confirm; withdraw the others."""

    def _spent_s(self) -> float:
        return self._clock() - self._begin_s

    def _set(self, **changes: Any) -> None:
        """Change fields of the record."""
        self._record = replace(self._record, **changes)

    def _note(self, attempt: Attempt) -> None:
        self._set(attempts=[*self._record.attempts, attempt])

    def _recommend(
        self,
        first: Attempt,
        second: Attempt,
        ratio: Ratio,
        samples: Sequence[LaunchRow],
        is_allowed: bool = True,
    ) -> None:
        """Recommend settings that both looks confirm."""
        assert first.error is not None and second.error is not None, "it was confirmed"
        effects = [each.accuracy.effect for each in (first, second) if each.accuracy]
        recommendation = Recommendation(
            first.settings,
            ratio,
            first.error.larger(second.error),
            samples,
            max(effects, key=lambda effect: effect.rank, default=Effect.APPROXIMATE),
            second.accuracy,
            second.program,
            is_allowed,
        )
        self._set(front=[*self._record.front, recommendation])

    def _withdraw(self, settings: Sequence[Setting], reason: str) -> None:
        self._set(withdrawn=[*self._record.withdrawn, Withdrawal(settings, reason)])


class CSearch(Search[CMeasurements]):
    """A search for settings of C."""

    _settings: Sequence[Setting] = ()

    def _measure_present(self) -> None:
        plan = self._plan
        self._advance(0, "what there is to try", 0.0)
        survey = self._measure.survey(plan.seed)
        self._set(meshes=survey.meshes, stages=self._measure.stages())
        self._settings = [each for each in survey.settings if each.knob not in plan.skip]
        self._begin_s = self._clock()  # the budget is of the search
        self._advance(0, "the present settings, and a reference", 0.0)
        self._set(present=self._measure.baseline(plan.trials(0)))

    def _try_settings(self) -> list[Attempt]:
        return self._together([each for each in self._each_alone() if not each.settings[0].loses])

    @property
    def _present(self) -> Present:
        assert self._record.present is not None, "attempts follow the baseline"
        return self._record.present

    def _leave_untried(self, count: int = 1) -> None:
        self._set(untried=self._record.untried + count)

    # -- each setting alone -------------------------------------------------------------------

    def _each_alone(self) -> list[Attempt]:
        """Try each setting alone; return those that are certainly faster, and allowed."""
        promising: list[Attempt] = []
        for number, setting in enumerate(self._settings):
            if not self._has_time(ATTEMPTS_SHARE):
                self._leave_untried()
                continue
            self._advance(1, setting.label, number / (2 * len(self._settings)))
            attempt = self._measure.attempt((setting,), RUNG_NRUN)
            if self._is_promising(attempt):
                attempt = self._measure.attempt((setting,))
            if self._is_promising(attempt):
                promising.append(attempt)
            else:
                self._note(attempt)
        promising.sort(key=fronts.rank_of)
        return list(self._compared(promising))

    def _compared(self, promising: Sequence[Attempt]) -> Iterator[Attempt]:
        """Compare settings with the present ones in fresh processes; yield the faster ones."""
        for number, attempt in enumerate(promising):
            if not self._has_time(SINGLES_SHARE):
                self._leave_untried()
                self._note(attempt)
                continue
            self._advance(1, label(attempt.settings), 0.5 + number / (2 * len(promising)))
            paired = self._measure.compare(attempt.settings, self._plan.seed, SINGLE_S)
            if paired.status != Status.OK:
                attempt = replace(attempt, status=paired.status, detail=paired.detail)
            elif paired.ratio is None:  # its steps are too slow
                self._leave_untried()
            attempt = replace(attempt, ratio=paired.ratio)
            self._note(attempt)
            if paired.ratio is not None and saves_time(paired.ratio):
                yield attempt

    def _is_promising(self, attempt: Attempt) -> bool:
        """Return whether settings may be faster, and do no more than is allowed."""
        if attempt.time_ratio is None or attempt.time_ratio > 1 - LEAST_GAIN:
            return False
        return self._may_be(attempt)

    def _may_be(self, attempt: Attempt) -> bool:
        """Return whether settings do to the motion what they may."""
        if attempt.accuracy is None or attempt.time_ratio is None:
            return False
        effect = effect_of(attempt)
        if effect.rank > self._plan.only.rank:
            return False
        if effect == Effect.FREE:
            return True
        if not self._present.is_comparable:
            return False
        return error_of(attempt) <= (self._plan.max_error or MOST_ERROR)

    # -- together -----------------------------------------------------------------------------

    def _together(self, faster: Sequence[Attempt]) -> list[Attempt]:
        """Try combinations of settings that are faster alone."""
        chosen = fronts.combinations(faster, COMBINATIONS, random.Random(self._plan.seed))
        nrun, quads = RUNG_NRUN, RUNG_QUADS
        while len(chosen) > LAST_RUNG and self._has_time():
            tried = self._tried(chosen, nrun, quads)
            exact, others = fronts.by_exactness(tried, faster)
            # what changes less is recommended beside what is faster, so the two do not compete
            chosen = [
                each.settings for group in (exact, others) for each in fronts.better_half(group)
            ]
            nrun, quads = 2 * nrun, 2 * quads
        together = self._tried(chosen[:LAST_RUNG])
        for attempt in together:
            self._note(attempt)
        return [*faster, *together]

    def _tried(
        self, chosen: Sequence[tuple[Setting, ...]], nrun: int | None = None, quads: int = QUADS
    ) -> list[Attempt]:
        """Try combinations until time is up; return those that do what they may."""
        tried = []
        for number, settings in enumerate(chosen):
            if not self._has_time():
                self._leave_untried(len(chosen) - number)
                break
            self._advance(2, label(settings), number / len(chosen))
            tried.append(self._measure.attempt(settings, nrun, quads))
        return [each for each in tried if self._may_be(each)]

    # -- second look --------------------------------------------------------------------------

    def _second_look(self, attempts: Sequence[Attempt]) -> None:
        """Measure a front again, from starts and with controls that the search has not seen.

        Where settings are withdrawn, those that come next are looked at, while there is time.
        """
        plan, first_present = self._plan, self._present
        self._advance(3, "present settings from new starts", 0.0)
        lengths = first_present.ncontrol, first_present.horizon_ncontrol
        present = self._measure.baseline(plan.trials(1, *lengths))
        errors = first_present.error.share, present.error.share
        self._set(present=replace(present, error=first_present.error.larger(present.error)))
        looked: set[str] = set()
        while True:
            withdrawn = {label(each.settings) for each in self._record.withdrawn}
            left = [each for each in attempts if label(each.settings) not in withdrawn]
            front = fronts.pareto_front(left, plan.max_error, errors[0])
            new = [each for each in front if label(each.settings) not in looked]
            if not new or (looked and self._spent_s() > plan.budget_s):
                break
            for number, first in enumerate(new):
                self._advance(3, label(first.settings), number / len(new))
                self._look_again(first, *errors)
                looked.add(label(first.settings))
        by_effect = sorted(
            self._record.front, key=lambda each: (each.effect.rank, -each.ratio.estimate)
        )
        self._set(front=by_effect)

    def _look_again(self, first: Attempt, first_error: float, present_error: float) -> None:
        """Recommend settings, or withdraw them.

        Args:
          first_error: of the present settings, in the search.
          present_error: of the present settings, from the new starts.
        """
        settings = first.settings
        was_allowed = is_allowed(first, self._plan.max_error, first_error)
        second = self._measure.attempt(settings, quads=0)
        if reason := self._why_not(first, second, was_allowed, present_error):
            self._withdraw(settings, reason)
            return
        paired = self._measure.compare(settings, self._plan.seed + 1, FINAL_S)
        if paired.ratio is None or not saves_time(paired.ratio):
            self._withdraw(settings, _why_not_faster(paired))
            return
        self._recommend(first, second, paired.ratio, paired.samples, was_allowed)

    def _why_not(
        self, first: Attempt, second: Attempt, was_allowed: bool, present_error: float
    ) -> str:
        """Return why new starts do not confirm what settings do; empty where they do."""
        if second.accuracy is None:
            return second.detail
        was, now = effect_of(first), effect_of(second)
        if now.rank > was.rank:
            return f"{was} in the search, {now} from new starts"
        limit = self._plan.max_error
        if was_allowed and not is_allowed(second, limit, present_error):
            return f"an {too_far(error_of(second), allowed_error(limit, present_error))}"
        return ""

    def _has_time(self, share: float = 1.0) -> bool:
        """Return whether anything may begin before a share of the time for the first look."""
        reserved_s = min(FRONT * LEAST_FINAL_S, self._plan.budget_s / 2)
        return self._spent_s() < share * (self._plan.budget_s - reserved_s)


def too_far(error: float, limit: float) -> str:
    """Return that an error, as a share of the motion, is larger than allowed."""
    return (
        f"error of {100 * error:.2g} % of the motion from new starts, where"
        f" {100 * limit:.2g} % is allowed"
    )


def _why_not_faster(paired: VerdictRecord) -> str:
    """Return why fresh processes do not confirm that settings are faster."""
    if paired.status == Status.OK and paired.ratio is None:
        return "its steps are too slow to compare it within the time of a second look"
    return paired.detail or "not certainly faster from new starts"
