"""Search settings that make a model faster in C: each alone, the best together, a second look.

1. Every setting is timed alone, those first that save most by count, in a fresh process; those that
   seem faster again, and run from a few starts. The reference, which says by how much settings err,
   is run only where some of them change the motion. Then they are run from all starts, and timed in
   further processes, which give the figures.
2. The best of those that are certainly faster are run together.
3. The front, on which no settings are both faster and more accurate than others, is measured again
   from starts and with controls that the search has not seen. What that does not confirm is
   withdrawn.

A part has a share of the time that is left, and what does not fit is not begun.
"""

import random
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mjbench.commands.tune import knobs, pareto_front, setting_names
from mjbench.commands.tune.measurements import CMeasurements, summary, with_figures
from mjbench.commands.tune.pareto_front import (
    change_of,
    effect_of,
    error_of,
    is_allowed,
    time_ratio_of,
)
from mjbench.commands.tune.reference import HOLD, REFERENCE_S, CurrentSettings, TrialPlan
from mjbench.commands.tune.result import (
    Attempt,
    Effect,
    Limits,
    Recommendation,
    TuneRecord,
    Withdrawal,
    saves_time,
)
from mjbench.commands.tune.setting_launch import SettingLaunchRequest
from mjbench.commands.tune.settings import Settings, label
from mjbench.commands.tune.usual_regime import MAX_COMPUTING_S
from mjbench.errors import InputError, MachineError, MjbenchError, failure_of
from mjbench.formats import plain
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status

# A setting that saves less than this, by its first launches, is not looked at again.
LEAST_GAIN = 0.01
# A setting that costs more than this share, by its first launch, is not in the second one.
MOST_LOSS = 0.05
# An error of more than this share of the motion is no simulation of the model any more.
MOST_ERROR = 0.5
# Shares of the budget: computing of the survey, and of the reference.
SURVEY_SHARE, REFERENCE_SHARE = 0.04, 0.1
# Shares of the time that is left: each launch of screening, errors, figures, combinations, a
# reference at most; and the second look and its runs.
SCREEN_PART, ERRORS_PART, FIGURES_PART, TOGETHER_PART = 0.25, 0.35, 0.4, 0.5
REFERENCE_PART, SECOND_LOOK_PART, AGAIN_PART = 0.5, 0.3, 0.5
# Launches that give figures, at least and at most; those of the second look at most.
LEAST_LAUNCHES, MOST_LAUNCHES, MOST_FINAL_LAUNCHES = 4, 8, 16
# Seconds of timing of a setting in a launch, as a share of the budget, at least and at most.
TIMED_SHARE, LEAST_TIMED_S, MOST_TIMED_S = 0.002, 0.03, 0.2
# A launch of a few settings takes at least this share of the time of one of all: it starts a
# process.
SHARE_OF_START = 0.25
# Runs that show whether a setting changes anything.
FEW_NRUN = 8
# Settings that get figures of their own, and that are run from new starts, at most.
MOST_ALONE, MOST_AGAIN = 16, 12


# Called with how many parts of the search are done, what goes on, and a share of 0.
Advance = Callable[[int, str, float], None]
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      budget_s: seconds of the whole search, about; with less than a minute, there may be no time
        for a second look.
      allow: the largest effect of settings that are recommended.
      knobs: names of those that are tried.
    """

    seed: int = 0
    starts: StartPlan = field(default_factory=StartPlan)
    budget_s: float = 300.0
    limits: Limits = field(default_factory=Limits)
    allow: Effect = Effect.APPROXIMATE
    hold: int = HOLD
    knobs: tuple[str, ...] = setting_names.NAMES

    def trials(self, look: int, ncontrol: int | None = None) -> TrialPlan:
        """Return the starts and controls of a look: 0 for the search, 1 for the second look."""
        reference_s = min(REFERENCE_S, REFERENCE_SHARE * self.budget_s)
        return TrialPlan(self.seed + look, self.starts, self.hold, ncontrol, reference_s)


class CSearch:
    """One search for settings of one model."""

    def __init__(
        self,
        record: TuneRecord,
        plan: SearchPlan,
        measurements: CMeasurements,
        advance: Advance = lambda done, text, share: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._measure = measurements
        self._record = replace(record, seed=plan.seed, limits=plan.limits, allow=plan.allow)
        self._plan, self._advance, self._clock = plan, advance, clock
        self._begin_s, self._rng = clock(), random.Random(plan.seed)
        # what the present runs, the reference, and the last launch of so many settings took, and
        # what the second look has for itself
        self._present_s = self._reference_s = self._launch_s = self._second_look_s = 0.0
        self._nlaunched = 1
        self._tolerated_error = 0.0  # in the search, without the second look

    def result(self) -> TuneRecord:
        try:
            alone = self._alone(self._survey())
            self._look_again([*alone, *self._together(alone)])
        except MjbenchError as error:
            self._set(status=failure_of(error).status, detail=self._detail_of(error))
        except KeyboardInterrupt:
            self._set(status=Status.INTERRUPTED)
        return replace(self._record, seconds=self._clock() - self._begin_s)

    def _detail_of(self, error: MjbenchError) -> str:
        return failure_of(error).detail.removeprefix(f"{self._record.model}: ")

    # -- each setting alone -------------------------------------------------------------------

    def _survey(self) -> list[Settings]:
        """Run the present settings; return what there is to try, most counted gain first."""
        plan = self._plan
        self._advance(0, "what there is to try", 0.0)
        computing_s = min(MAX_COMPUTING_S, SURVEY_SHARE * plan.budget_s)
        settings = self._measure.survey(plan.seed, computing_s)
        self._advance(0, "the present settings", 0.5)
        begin_s = self._clock()
        present, stages, collision, self._reference_s = self._measure.present(plan.trials(0))
        self._present_s = self._clock() - begin_s
        self._second_look_s = min(2 * self._present_s, SECOND_LOOK_PART * self._left_s)
        self._set(present=present, stages=stages, collision=collision)
        wanted = [each for each in settings if each.knob in plan.knobs]
        return [(each,) for each in sorted(wanted, key=lambda s: knobs.order(s, stages))]

    def _alone(self, settings: Sequence[Settings]) -> list[Attempt]:
        """Return the settings that are certainly faster and do what they may."""
        self._advance(1, f"{len(settings)} settings", 0.0)
        first = self._noted(self._launch(settings, SCREEN_PART))
        hopeful = [each.settings for each in first if time_ratio_of(each) < 1 + MOST_LOSS]
        again = self._launch(hopeful, SCREEN_PART, nrun=FEW_NRUN)
        by_settings = {each.settings: each for each in first}
        seen = self._noted(summary([by_settings[each.settings], each]) for each in again)
        faster = [each for each in seen if time_ratio_of(each) <= 1 - LEAST_GAIN]
        allowed = [each for each in faster if self._may_change_so_much(each)]
        allowed = sorted(allowed, key=time_ratio_of)[:MOST_ALONE]
        if any(map(self._needs_error, allowed)):
            self._advance(1, "the reference", 0.4)
            self._set(present=self._reference() or self._present)
        self._tolerated_error = self._present.tolerated_error
        self._advance(1, f"the error of {len(allowed)} settings", 0.6)
        wanted = [each.settings for each in allowed]
        judged = self._launch(wanted, ERRORS_PART, nrun=None, has_stages=True)
        launched = {each.settings: [each] for each in judged}
        self._leave_untried([*settings[len(first) :], *hopeful[len(again) :]])
        self._leave_untried(wanted[len(judged) :])
        self._advance(1, f"the time of {len(judged)} settings", 0.8)
        self._repeat(launched, MOST_LAUNCHES, FIGURES_PART)
        timed = self._noted(with_figures(each[0], each) for each in launched.values())
        certain = [each for each in timed if each.ratio and saves_time(each.ratio)]
        return [each for each in certain if self._may_be(each) and not each.gives_up]

    # -- together -----------------------------------------------------------------------------

    def _together(self, alone: Sequence[Attempt]) -> list[Attempt]:
        """Return those combinations that do what they may."""
        chosen = pareto_front.combinations(alone)
        self._advance(2, f"{len(chosen)} combinations", 0.0)
        tried = self._launch(chosen, TOGETHER_PART, nrun=None)
        self._leave_untried(chosen[len(tried) :])
        return self._noted(each for each in tried if self._may_be(each))

    # -- second look --------------------------------------------------------------------------

    def _look_again(self, attempts: Sequence[Attempt]) -> None:
        """Measure the best again, from starts and with controls that the search has not seen."""
        if not (front := self._front(attempts)):
            return
        self._second_look_s = 0.0
        takes_s = self._present_s + (1 + LEAST_LAUNCHES) * self._expected_s(len(front))
        if takes_s > self._left_s:
            self._set(no_second_look=self._no_time(takes_s))
            self._recommend_at_once(attempts, front)
            return
        self._advance(3, "present settings from new starts", 0.0)
        error = self._present_again(any(map(self._needs_error, front)))
        others = [each for each in attempts if each not in front]
        looked = [*front, *sorted(others, key=time_ratio_of)][:MOST_AGAIN]
        self._advance(3, f"{len(looked)} settings from new starts", 0.3)
        again = self._launch([each.settings for each in looked], AGAIN_PART, nrun=None)
        self._leave_untried([each.settings for each in front[len(again) :] if not each.ratio])
        # what was timed alone stays where there was no time to run it again
        confirmed = {each.settings: (each, each) for each in looked[len(again) :] if each.ratio}
        for first, second in zip(looked, again, strict=False):
            if reason := self._why_not(first, second, error):
                if first in front:
                    self._withdraw(first, reason)
            else:
                confirmed[first.settings] = first, second
        has_time = self._expected_s(1) < self._left_s
        timed = [each for each, _ in confirmed.values() if each.ratio or has_time]
        final = [each.settings for each in self._front(timed)]
        self._advance(3, f"the time of {len(final)} settings", 0.6)
        launched = {each: [confirmed[each][1]] for each in final}
        try:
            self._repeat(launched, MOST_FINAL_LAUNCHES, 1.0)
        finally:  # Ctrl-C, or a crash, leaves what is known
            for settings, rows in launched.items():
                first, second = confirmed[settings]
                if len(rows) > 1:
                    self._recommend(first, with_figures(second, rows))
                elif first.ratio:  # there was no time for more than one launch
                    self._recommend(first, replace(second, ratio=first.ratio))

    def _recommend_at_once(self, attempts: Sequence[Attempt], front: Sequence[Attempt]) -> None:
        """Recommend what is certainly faster; of the front, time what has no figures yet."""
        launched = {each.settings: [replace(each, launches=())] for each in front if not each.ratio}
        try:
            self._repeat(launched, LEAST_LAUNCHES + 1, 1.0)
        finally:  # as above
            figures = [with_figures(rows[0], rows) for rows in launched.values() if len(rows) > 2]
            certain = [each for each in figures if each.ratio and saves_time(each.ratio)]
            for each in self._front([*(each for each in attempts if each.ratio), *certain]):
                self._recommend(each, each)

    def _front(self, attempts: Sequence[Attempt]) -> list[Attempt]:
        return pareto_front.pareto_front(attempts, self._plan.limits, self._tolerated_error)

    def _present_again(self, needs_error: bool) -> float:
        """Run the present settings from new starts, and the reference; return the error there."""
        first = self._present
        present, *_ = self._measure.present(self._plan.trials(1, first.ncontrol))
        if needs_error:
            present = self._reference(first.horizon_ncontrol) or present
        if first.error is None:
            self._set(present=present)
        elif present.error is not None:
            self._set(present=replace(present, error=first.error.larger(present.error)))
        return present.tolerated_error if present.error else self._tolerated_error

    def _why_not(self, first: Attempt, second: Attempt, error: float) -> str:
        """Return why new starts do not confirm what settings do; empty where they do.

        Args:
          error: of the present settings, tolerated from new starts.
        """
        if second.accuracy is None:
            return second.detail
        was, now, limits = effect_of(first), effect_of(second), self._plan.limits
        if now.rank > was.rank:
            return f"{was} in the search, {now} from new starts"
        is_judged = is_allowed(first, limits, self._tolerated_error)
        most_error = limits.allowed_error(error) if is_judged else MOST_ERROR
        if is_judged and is_allowed(_with_error(second, first), limits, error):
            return ""
        for name, share, most in (
            ("a change", change_of(second), limits.allowed_change),
            ("an error", error_of(_with_error(second, first)), most_error),
        ):
            if share > most:
                return (
                    f"{name} of {100 * share:.2g} % of the motion from new starts, where"
                    f" {100 * most:.2g} % is allowed"
                )
        return ""

    def _recommend(self, first: Attempt, second: Attempt) -> None:
        """Recommend settings that both looks confirm, or withdraw them, if they are not faster."""
        if second.ratio is None or not saves_time(second.ratio):
            self._withdraw(first, second.detail or "not certainly faster from new starts")
            return
        assert first.accuracy is not None and second.accuracy is not None, "neither failed"
        accuracy = replace(
            second.accuracy,
            sensor_share=max(second.accuracy.sensor_share, first.accuracy.sensor_share),
            distance=second.accuracy.distance.larger(first.accuracy.distance),
        )
        error = _with_error(second, first).error
        recommendation = Recommendation(
            first.settings,
            second.ratio,
            first.error.larger(error) if first.error and error else None,
            second.launches,
            first.accuracy.effect,
            accuracy,
            is_allowed(first, self._plan.limits, self._tolerated_error),
        )
        front = [*self._record.front, recommendation]
        self._set(front=sorted(front, key=lambda each: (each.effect.rank, -each.ratio.estimate)))

    def _withdraw(self, attempt: Attempt, reason: str) -> None:
        self._set(withdrawn=[*self._record.withdrawn, Withdrawal(attempt.settings, reason)])

    # -- what settings may do -----------------------------------------------------------------

    @property
    def _present(self) -> CurrentSettings:
        assert self._record.present is not None, "attempts follow the present runs"
        return self._record.present

    def _needs_error(self, attempt: Attempt) -> bool:
        effect = effect_of(attempt)
        is_limited = self._plan.limits.are_set
        return effect == Effect.APPROXIMATE or (effect == Effect.EQUIVALENT and is_limited)

    def _may_change_so_much(self, attempt: Attempt) -> bool:
        """Return whether settings change no more than the user allows, whatever their error is."""
        return attempt.accuracy is not None and effect_of(attempt).rank <= self._plan.allow.rank

    def _may_be(self, attempt: Attempt) -> bool:
        if attempt.status != Status.OK or not self._may_change_so_much(attempt):
            return False
        if not self._needs_error(attempt):
            return True
        if attempt.error is None or not self._present.is_comparable:
            return False
        limits = self._plan.limits
        is_near = change_of(attempt) <= limits.allowed_change
        return is_near and error_of(attempt) <= (limits.max_error or MOST_ERROR)

    def _reference(self, horizon_ncontrol: int | None = None) -> CurrentSettings | None:
        """Run the reference; None where it fails or does not fit, which the record says."""
        if self._reference_s > REFERENCE_PART * self._left_s:
            self._set(no_reference=self._no_time(self._reference_s))
            return None
        begin_s = self._clock()
        try:
            return self._measure.reference(horizon_ncontrol)
        except (InputError, MachineError) as error:
            self._set(no_reference=self._detail_of(error))
            return None
        finally:  # on a busy machine it takes longer than its steps say
            self._reference_s = max(self._reference_s, self._clock() - begin_s)

    # -- launches and time --------------------------------------------------------------------

    @property
    def _left_s(self) -> float:
        """Seconds that are left to what comes before the second look, and then to that."""
        end_s = self._begin_s + self._plan.budget_s - self._second_look_s
        return end_s - self._clock()

    def _no_time(self, takes_s: float) -> str:
        return f"it takes about {plain(takes_s, 2)} s, and {plain(self._left_s, 2)} s were left"

    def _expected_s(self, nsetting: int) -> float:
        """Return about how long a launch of some settings takes, that does no more than time."""
        return max(nsetting / self._nlaunched, SHARE_OF_START) * self._launch_s

    def _launch(self, settings: Sequence[Settings], part: float, **what: Any) -> list[Attempt]:
        """Time settings in a fresh process; return what is begun in a part of the time left."""
        begin_s, stop_after_s = self._clock(), part * self._left_s
        if not settings or stop_after_s <= 0:
            return []
        timed_s = min(MOST_TIMED_S, max(LEAST_TIMED_S, TIMED_SHARE * self._plan.budget_s))
        seed = self._rng.randrange(2**31)
        attempts = self._measure.launch(
            SettingLaunchRequest(settings, timed_s, seed=seed, stop_after_s=stop_after_s, **what)
        )
        if attempts and not what:
            self._nlaunched, self._launch_s = len(attempts), self._clock() - begin_s
        return attempts

    def _repeat(self, launched: dict[Settings, list[Attempt]], most: int, part: float) -> None:
        """Time settings in further processes, in any order; settings that fail leave.

        Args:
          launched: one attempt of each, to which others are added.
          most: launches in all; beyond LEAST_LAUNCHES, none begins that would end after a part of
            the time left.
        """
        spare_s = (1 - part) * self._left_s
        for number in range(1, most):
            left = [each for each, rows in launched.items() if rows[-1].status == Status.OK]
            keeps_s = spare_s if number >= LEAST_LAUNCHES else 0.0
            if self._expected_s(len(left)) + keeps_s > self._left_s:
                return
            for attempt in self._launch(self._rng.sample(left, len(left)), 1.0):
                launched[attempt.settings].append(attempt)

    def _leave_untried(self, left: Sequence[Settings]) -> None:
        record, alone = self._record, [each[0] for each in left if len(each) == 1]
        halving = [each for each in alone if knobs.halves(each, record.stages or {})]
        self._set(
            untried=record.untried + len(alone),
            untried_combinations=record.untried_combinations + len(left) - len(alone),
            untried_halving=[*record.untried_halving, *halving],
        )

    def _set(self, **changes: Any) -> None:
        self._record = replace(self._record, **changes)

    def _noted(self, attempts: Iterable[Attempt]) -> list[Attempt]:
        """Return attempts, each of which is in the record in place of an earlier one."""
        new = list(attempts)
        names = {label(each.settings) for each in new}
        others = [each for each in self._record.attempts if label(each.settings) not in names]
        self._set(attempts=[*others, *new])
        return new


def _with_error(attempt: Attempt, first: Attempt) -> Attempt:
    """Return an attempt with the error of the search, where there was no other reference."""
    if attempt.error is not None or attempt.accuracy is None:
        return attempt
    return replace(attempt, accuracy=replace(attempt.accuracy, error=first.error))
