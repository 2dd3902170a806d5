"""Search settings that make a model faster: each alone, then together, then a second look.

1. Every setting is tried alone, in a process of its own; those that seem faster are compared with
   the present settings in fresh processes.
2. Those that are faster are combined. Combinations are tried on few runs first; the better half
   goes on to more runs (successive halving: Jamieson and Talwalkar, AISTATS 2016).
3. The front, on which no setting is both faster and nearer to the reference than another, is
   measured again from starts and with controls that the search has not seen. What that does not
   confirm is withdrawn.
"""

import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from mjbench.errors import MjbenchError, failure_of
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning import fronts
from mjbench.tuning.attempts import QUADS, Attempt, Effect
from mjbench.tuning.fronts import FRONT, Faster, effect_of, error_of, is_allowed
from mjbench.tuning.measurements import Measurements, PairedTime
from mjbench.tuning.records import (
    AttemptRow,
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

Record = TypeVar("Record")


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      budget_s: seconds after which nothing is begun but the second look.
      max_error: the largest error allowed, as a share of the motion; None for the present one.
      hold: steps for which each control is held.
      skip: names of knobs that are left alone.
    """

    seed: int = 0
    starts: StartPlan = field(default_factory=StartPlan)
    budget_s: float = 300.0
    max_error: float | None = None
    only: Effect = Effect.APPROXIMATE
    hold: int = HOLD
    skip: tuple[str, ...] = ()

    def trials(self, look: int, present: Present | None = None) -> TrialPlan:
        """Return the starts and controls of a look.

        Args:
          look: 0 for the search, 1 for the second look, more for further ones.
          present: of the search, whose runs and horizon a further look has; None for the search.
        """
        if present is None:
            return TrialPlan(self.seed + look, self.starts, self.hold)
        lengths = present.ncontrol, present.horizon_ncontrol
        return TrialPlan(self.seed + look, self.starts, self.hold, *lengths)


class Search:
    """One search for settings of one model; `record` says what came of it, at any time."""

    def __init__(
        self,
        model: str,
        settings: Sequence[Setting],
        plan: SearchPlan,
        measurements: Measurements,
        advance: Advance = lambda done, text, share: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Measure nothing yet."""
        self._model, self._settings, self._plan = model, settings, plan
        self._measure, self._advance, self._clock = measurements, advance, clock
        self._begin_s = clock()
        self._present: Present | None = None
        self._rows: list[AttemptRow] = []
        self._untried = 0
        self._front: list[Recommendation] = []
        self._withdrawn: list[Withdrawal] = []

    def run(self) -> None:
        """Search.

        Raises:
          InputError: the model cannot be stepped.
          MachineError: its process crashed or hung.
          KeyboardInterrupt: the user ended it; `record` has what was measured.
        """
        plan = self._plan
        self._advance(0, "the present settings, and a reference", 0.0)
        self._present = self._measure.baseline(plan.trials(0))
        faster = [each for each in self._each_alone() if not each.setting.loses]
        attempts = self._together(faster)
        if attempts:
            self._second_look(attempts, self._present)

    def record(self, status: Status = Status.OK, detail: str = "") -> TuneRecord:
        """Return what was measured so far."""
        return TuneRecord(
            model=self._model,
            status=status,
            detail=detail,
            seed=self._plan.seed,
            max_error=self._plan.max_error,
            only=self._plan.only,
            present=self._present,
            attempts=self._rows,
            untried=self._untried,
            front=self._front,
            withdrawn=self._withdrawn,
            seconds=self._clock() - self._begin_s,
        )

    # -- each setting alone -------------------------------------------------------------------

    def _each_alone(self) -> list[Faster]:
        """Try each setting alone; return those that are certainly faster, and allowed."""
        promising: list[Attempt] = []
        for number, setting in enumerate(self._settings):
            if not self._has_time(ATTEMPTS_SHARE):
                self._untried += 1
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

    def _compared(self, promising: Sequence[Attempt]) -> Iterator[Faster]:
        """Compare settings with the present ones in fresh processes; yield the faster ones."""
        for number, attempt in enumerate(promising):
            if not self._has_time(SINGLES_SHARE):
                self._untried += 1
                self._note(attempt)
                continue
            self._advance(1, label(attempt.settings), 0.5 + number / (2 * len(promising)))
            paired = self._measure.compare(attempt.settings, self._plan.seed, SINGLE_S)
            self._note(attempt, paired)
            if paired.status == Status.OK and paired.ratio is None:  # its steps are too slow
                self._untried += 1
            if paired.is_faster and paired.ratio is not None:
                yield Faster(attempt, paired.ratio.estimate)

    def _is_promising(self, attempt: Attempt) -> bool:
        """Return whether settings may be faster, and do no more than is allowed."""
        if attempt.time_ratio is None or attempt.time_ratio > 1 - LEAST_GAIN:
            return False
        return self._may_be(attempt)

    def _may_be(self, attempt: Attempt) -> bool:
        """Return whether settings do to the motion what they may."""
        assert self._present is not None, "attempts follow the baseline"
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

    def _note(self, attempt: Attempt, paired: PairedTime | None = None) -> None:
        """Note how settings did."""
        failed = paired if paired is not None and paired.status != Status.OK else None
        self._rows.append(
            AttemptRow(
                attempt.settings,
                attempt.status if failed is None else failed.status,
                attempt.detail if failed is None else failed.detail,
                attempt.accuracy,
                attempt.time_ratio,
                None if paired is None else paired.ratio,
            )
        )

    # -- together -----------------------------------------------------------------------------

    def _together(self, faster: Sequence[Faster]) -> list[Attempt]:
        """Try combinations of settings that are faster alone.

        Returns:
          Settings alone and together, from all starts: at least those alone.
        """
        alone = [each.attempt for each in faster]
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
        return [*alone, *together]

    def _tried(
        self, chosen: Sequence[tuple[Setting, ...]], nrun: int | None = None, quads: int = QUADS
    ) -> list[Attempt]:
        """Try combinations until time is up; return those that do what they may."""
        tried = []
        for number, settings in enumerate(chosen):
            if not self._has_time():
                self._untried += len(chosen) - number
                break
            self._advance(2, label(settings), number / len(chosen))
            tried.append(self._measure.attempt(settings, nrun, quads))
        return [each for each in tried if self._may_be(each)]

    # -- second look --------------------------------------------------------------------------

    def _second_look(self, attempts: Sequence[Attempt], first_present: Present) -> None:
        """Measure a front again, from starts and with controls that the search has not seen.

        Where settings are withdrawn, those that come next are looked at, while there is time.

        Args:
          attempts: of the search, from all starts.
          first_present: the present settings, in the search.
        """
        plan = self._plan
        self._advance(3, "present settings from new starts", 0.0)
        present = self._measure.baseline(plan.trials(1, first_present))
        self._present = replace(present, error=first_present.error.larger(present.error))
        looked: set[str] = set()
        while True:
            withdrawn = {label(each.settings) for each in self._withdrawn}
            left = [each for each in attempts if label(each.settings) not in withdrawn]
            front = fronts.pareto_front(left, plan.max_error, first_present.error.share)
            new = [each for each in front if label(each.settings) not in looked]
            if not new or (looked and self._clock() - self._begin_s > plan.budget_s):
                break
            for number, first in enumerate(new):
                self._advance(3, label(first.settings), number / len(new))
                self._look_again(first, first_present, present)
                looked.add(label(first.settings))
        self._front.sort(key=lambda each: (each.effect.rank, -each.ratio.estimate))

    def _look_again(self, first: Attempt, first_present: Present, present: Present) -> None:
        """Recommend settings, or withdraw them.

        Args:
          first: how they did in the search.
          first_present: the present settings, in the search.
          present: the present settings, from the new starts.
        """
        limit = self._plan.max_error
        was_allowed = is_allowed(first, limit, first_present.error.share)
        second = self._measure.attempt(first.settings, quads=0)
        reason = self._why_not(first, second, was_allowed, present)
        if not reason:
            paired = self._measure.compare(first.settings, self._plan.seed + 1, FINAL_S)
            reason = _why_not_faster(paired)
        if reason:
            self._withdrawn.append(Withdrawal(first.settings, reason))
            return
        assert first.accuracy and second.accuracy and paired.ratio, "it was confirmed"
        effects = first.accuracy.effect, second.accuracy.effect
        self._front.append(
            Recommendation(
                first.settings,
                max(effects, key=lambda effect: effect.rank),
                paired.ratio,
                first.accuracy.error.larger(second.accuracy.error),
                second.accuracy,
                was_allowed,
                paired.launches,
            )
        )

    def _why_not(self, first: Attempt, second: Attempt, was_allowed: bool, present: Present) -> str:
        """Return why new starts do not confirm what settings do; empty where they do.

        Args:
          first: how they did in the search.
          second: how they do from new starts.
          was_allowed: whether their error in the search was.
          present: the present settings, from the new starts.
        """
        if second.accuracy is None:
            return second.detail
        was, now = effect_of(first), effect_of(second)
        if now.rank > was.rank:
            return f"{was} in the search, {now} from new starts"
        share = present.error.share
        if was_allowed and not is_allowed(second, self._plan.max_error, share):
            return (
                f"an error of {100 * error_of(second):.2g} % of the motion from new starts, where"
                f" {100 * allowed_error(self._plan.max_error, share):.2g} % is allowed"
            )
        return ""

    def _has_time(self, share: float = 1.0) -> bool:
        """Return whether anything may begin before a share of the search, without its second look.

        Args:
          share: of the time before the second look.
        """
        reserved_s = min(FRONT * LEAST_FINAL_S, self._plan.budget_s / 2)
        return self._clock() - self._begin_s < share * (self._plan.budget_s - reserved_s)


def ended(run: Callable[[], None], record: Callable[[Status, str], Record]) -> Record:
    """Return the record of a search, however it ended.

    Args:
      record: returns what was measured, from how the search ended and why, in one line.
    """
    try:
        run()
    except MjbenchError as error:
        failure = failure_of(error)
        return record(failure.status, failure.detail)
    except KeyboardInterrupt:
        return record(Status.INTERRUPTED, "")
    return record(Status.OK, "")


def _why_not_faster(paired: PairedTime) -> str:
    """Return why fresh processes do not confirm that settings are faster; empty where they do."""
    if paired.is_faster:
        return ""
    if paired.status == Status.OK and paired.ratio is None:
        return "its steps are too slow to compare it within the time of a second look"
    return paired.detail or "not certainly faster from new starts"
