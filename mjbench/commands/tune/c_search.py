"""Search settings that make a model faster in C: each alone, then together, then a second look.

1. Every setting is timed alone, the likely gains first, in a few fresh processes that time all of
   them. Those that seem faster are run from some starts, to see whether they change anything, and
   timed again in further processes, which give the figures.
2. Only where some of them change the motion, the reference is run, which says by how much they err.
3. Those that are faster are combined. Combinations are tried on few runs first; the better half
   goes on to more runs (successive halving: Jamieson and Talwalkar, AISTATS 2016).
4. The front, on which no setting is both faster and nearer to the reference than another, is
   measured again from starts and with controls that the search has not seen. What that does not
   confirm is withdrawn.
"""

import functools
import math
import random
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from mjbench.commands.tune import knobs, pareto_front
from mjbench.commands.tune.accuracy import Distance
from mjbench.commands.tune.measurements import (
    CMeasurements,
    SettingRule,
    SettingTargets,
    together_known,
    with_accuracy,
    with_figures,
)
from mjbench.commands.tune.pareto_front import FRONT, effect_of, error_of, is_allowed
from mjbench.commands.tune.reference import Present
from mjbench.commands.tune.result import (
    Attempt,
    Effect,
    Recommendation,
    TuneRecord,
    Withdrawal,
    allowed_error,
    saves_time,
)
from mjbench.commands.tune.search_plan import LEAST_GAIN, Advance, SearchPlan
from mjbench.commands.tune.setting_launch import SettingLaunchRequest
from mjbench.commands.tune.settings import Setting, Settings, label
from mjbench.commands.tune.usual_regime import MAX_COMPUTING_S
from mjbench.errors import InputError, MachineError, MjbenchError, failure_of
from mjbench.measuring.ratio import Ratio
from mjbench.paired import launches
from mjbench.paired.records import LaunchRow
from mjbench.status import Status
from mjbench.units import plain

# A setting that costs more than this share, by its first launch, is not in the second one.
MOST_LOSS = 0.05
# An error of more than this share of the motion is no simulation of the model any more.
MOST_ERROR = 0.5
# Shares of the budget: computing of the survey, and when screening ends, the figures of each
# setting, their errors, and combinations.
SURVEY_SHARE = 0.04
SCREEN_END, FIGURES_END, ERRORS_END, TOGETHER_END = 0.3, 0.5, 0.65, 0.75
# A part that begins late takes at most this share of the budget.
LEAST_PART = 0.1
# Launches that choose settings; that give figures, at least and at most; of the second look, too.
SCREENS, LEAST_LAUNCHES, MOST_LAUNCHES, MOST_FINAL_LAUNCHES = 2, 4, 8, 16
# Seconds of timing of a setting in a launch, as a share of the budget, at least and at most.
TIMED_SHARE, LEAST_TIMED_S, MOST_TIMED_S = 0.002, 0.03, 0.2
# Settings that get figures of their own: of those that change no motion, and of the others.
MOST_ALONE = 10
# Combinations that are tried; runs of each in the first rung.
COMBINATIONS, RUNG_NRUN = 32, 8
# Of those, so many are tried from all starts.
LAST_RUNG = 2 * FRONT


class CSearch:
    """One search for settings of one model."""

    _settings: Sequence[Setting] = ()
    _reference_s: float = 0.0

    def __init__(
        self,
        record: TuneRecord,
        plan: SearchPlan,
        measurements: CMeasurements,
        advance: Advance = lambda done, text, share: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._measure = measurements
        self._record = replace(record, seed=plan.seed, max_error=plan.max_error, only=plan.only)
        self._plan, self._advance, self._clock = plan, advance, clock
        self._begin_s = clock()

    def result(self) -> TuneRecord:
        try:
            self._measure_present()
            if attempts := self._try_settings():
                self._second_look(attempts)
        except MjbenchError as error:
            self._set(status=failure_of(error).status, detail=self._detail_of(error))
        except KeyboardInterrupt:
            self._set(status=Status.INTERRUPTED)
        return replace(self._record, seconds=self._clock() - self._begin_s)

    def _detail_of(self, error: MjbenchError) -> str:
        return failure_of(error).detail.removeprefix(f"{self._record.model}: ")

    def _measure_present(self) -> None:
        plan = self._plan
        self._advance(0, "what there is to try", 0.0)
        computing_s = min(MAX_COMPUTING_S, SURVEY_SHARE * plan.budget_s)
        settings, meshes = self._measure.survey(plan.seed, computing_s)
        self._advance(0, "the present settings", 0.5)
        present, stages, self._reference_s = self._measure.present(plan.trials(0))
        self._set(meshes=meshes, present=present, stages=stages)
        wanted = [each for each in settings if each.knob not in plan.skip]
        self._settings = sorted(wanted, key=lambda each: -knobs.likely_gain(each, stages))
        self._rng = random.Random(plan.seed)

    def _try_settings(self) -> list[Attempt]:
        faster = [
            each for each in self._figures(self._screen()) if each.ratio and saves_time(each.ratio)
        ]
        judged = self._judged(faster)
        return self._together([each for each in judged if not each.gives_up])

    @property
    def _present(self) -> Present:
        assert self._record.present is not None, "attempts follow the present runs"
        return self._record.present

    def _leave_untried(self, count: int) -> None:
        self._set(untried=self._record.untried + count)

    def _needs_error(self, attempt: Attempt) -> bool:
        effect = effect_of(attempt)
        has_limit = self._plan.max_error is not None
        return effect == Effect.APPROXIMATE or (effect == Effect.EQUIVALENT and has_limit)

    def _reference(self, horizon_ncontrol: int | None = None) -> Present | None:
        """Run the reference; None where it fails or there is no time, which the record says."""
        left_s = self._end_s(1.0) - self._clock()
        if self._reference_s > left_s:
            self._set(
                no_reference=f"it takes about {plain(self._reference_s, 2)} s, and"
                f" {plain(left_s, 2)} s were left"
            )
            return None
        begin_s = self._clock()
        try:
            return self._measure.reference(horizon_ncontrol)
        except (InputError, MachineError) as error:
            self._set(no_reference=self._detail_of(error))
            return None
        finally:  # on a busy machine it takes longer than its steps say
            self._reference_s = max(self._reference_s, self._clock() - begin_s)

    # -- each setting alone -------------------------------------------------------------------

    def _screen(self) -> list[Attempt]:
        """Time each setting; return those that may be faster, and do no more than is allowed."""
        self._advance(1, f"{len(self._settings)} settings", 0.0)
        settings = [(each,) for each in self._settings]
        by_setting = self._launched(settings, 1, SCREENS, SCREEN_END, FIGURES_END)
        self._leave_untried(len(settings) - len(by_setting))
        timed = [together_known(launches) for launches in by_setting]
        for attempt in timed:
            self._note(attempt)
        promising = [
            each
            for each in timed
            if each.time_ratio is not None and each.time_ratio <= 1 - LEAST_GAIN
        ]
        self._advance(1, f"what {len(promising)} settings change", 0.3)
        tried = [each.settings for each in promising]
        seen = self._measure.launch(self._request(tried, nrun=RUNG_NRUN, end=FIGURES_END))
        known = [with_accuracy(*pair) for pair in zip(promising, seen, strict=False)]
        for attempt in known:
            self._note(attempt)
        self._leave_untried(len(promising) - len(known))
        allowed = [each for each in known if self._may_change_so_much(each)]
        return [*_fastest(allowed, exact=True), *_fastest(allowed, exact=False)]

    def _figures(self, promising: Sequence[Attempt]) -> Iterator[Attempt]:
        self._advance(1, f"the time of {len(promising)} settings", 0.5)
        settings = [each.settings for each in promising]
        launches = self._launched(settings, LEAST_LAUNCHES, MOST_LAUNCHES, FIGURES_END)
        for attempt, of_setting in zip(promising, launches, strict=True):
            timed = with_figures(attempt, of_setting)
            self._note(timed)
            yield timed

    def _judged(self, faster: Sequence[Attempt]) -> list[Attempt]:
        """Run settings from all starts; return those that do what they may."""
        if any(self._needs_error(each) for each in faster):
            self._advance(1, "the reference", 0.7)
            self._set(present=self._reference() or self._present)
        self._advance(1, f"the error of {len(faster)} settings", 0.8)
        settings = [each.settings for each in faster]
        seen = self._measure.launch(
            self._request(settings, nrun=None, end=ERRORS_END, has_stages=True)
        )
        judged = [with_accuracy(*pair) for pair in zip(faster, seen, strict=False)]
        for attempt in judged:
            self._note(attempt)
        late = faster[len(judged) :]  # there was no time to run them from all starts
        allowed = [each for each in late if self._may_be(each)]
        self._leave_untried(len(late) - len(allowed))
        allowed += [each for each in judged if self._may_be(each)]
        return sorted(allowed, key=pareto_front.rank_of)

    def _may_change_so_much(self, attempt: Attempt) -> bool:
        """Return whether settings change no more than the user allows, whatever their error is."""
        is_known = attempt.accuracy is not None
        return is_known and effect_of(attempt).rank <= self._plan.only.rank

    def _may_be(self, attempt: Attempt) -> bool:
        if attempt.status != Status.OK or attempt.time_ratio is None:
            return False
        if not self._may_change_so_much(attempt):
            return False
        if not self._needs_error(attempt):
            return True
        if attempt.error is None or not self._present.is_comparable:
            return False
        return error_of(attempt) <= (self._plan.max_error or MOST_ERROR)

    # -- together -----------------------------------------------------------------------------

    def _together(self, faster: Sequence[Attempt]) -> list[Attempt]:
        chosen = pareto_front.combinations(faster, COMBINATIONS, self._rng)
        nrun = RUNG_NRUN
        while len(chosen) > LAST_RUNG and self._has_time(TOGETHER_END):
            tried = self._tried(chosen, nrun)
            exact, others = pareto_front.by_exactness(tried, faster)
            # what changes less is recommended beside what is faster, so the two do not compete
            chosen = [
                each.settings
                for group in (exact, others)
                for each in pareto_front.better_half(group)
            ]
            nrun *= 2
        self._leave_combinations(len(chosen) - LAST_RUNG)
        together = self._tried(chosen[:LAST_RUNG], None)
        for attempt in together:
            self._note(attempt)
        return [*faster, *together]

    def _tried(self, chosen: Sequence[Settings], nrun: int | None) -> list[Attempt]:
        self._advance(2, f"{len(chosen)} combinations", 0.0)
        request = self._request(chosen, self._timed_s, nrun, TOGETHER_END)
        tried = self._measure.launch(request) if chosen else []
        self._leave_combinations(len(chosen) - len(tried))
        return [each for each in tried if self._may_be(each)]

    def _leave_combinations(self, count: int) -> None:
        self._set(untried_combinations=self._record.untried_combinations + max(0, count))

    # -- second look --------------------------------------------------------------------------

    def _second_look(self, attempts: Sequence[Attempt]) -> None:
        """Measure a front again, from starts and with controls that the search has not seen.

        Where settings are withdrawn, those that come next are looked at, while there is time.
        """
        first_error = self._present.tolerated_error
        front = pareto_front.pareto_front(attempts, self._plan.max_error, first_error)
        if not front:
            return
        error = self._present_again(attempts)
        if self._record.no_reference:
            for each in filter(self._needs_error, front):
                reason = f"no reference from new starts: {self._record.no_reference}"
                self._withdraw(each.settings, reason)
            attempts = [each for each in attempts if not self._needs_error(each)]
            front = pareto_front.pareto_front(attempts, self._plan.max_error, first_error)
        confirmed: list[tuple[Attempt, Attempt]] = []
        looked: set[str] = set()
        while new := [each for each in front if label(each.settings) not in looked]:
            self._advance(3, f"{len(new)} settings from new starts", 0.3)
            confirmed += self._confirmed(new, first_error, error)
            looked.update(label(each.settings) for each in new)
            if not self._has_time(1.0):
                break
            withdrawn = {label(each.settings) for each in self._record.withdrawn}
            left = [each for each in attempts if label(each.settings) not in withdrawn]
            front = pareto_front.pareto_front(left, self._plan.max_error, first_error)
        self._time_again(confirmed, first_error)

    def _present_again(self, attempts: Sequence[Attempt]) -> float:
        """Run the present settings from new starts; return the error that is tolerated there.

        The reference is run again where settings need an error.
        """
        first = self._present
        self._advance(3, "present settings from new starts", 0.0)
        lengths = first.ncontrol, first.horizon_ncontrol
        present, _, _ = self._measure.present(self._plan.trials(1, *lengths))
        if first.error is None:
            self._set(present=present)
        elif any(self._needs_error(each) for each in attempts):
            present = self._reference(first.horizon_ncontrol) or present
            if present.error is not None:
                self._set(present=replace(present, error=first.error.larger(present.error)))
        return present.tolerated_error

    def _confirmed(
        self, new: Sequence[Attempt], first_error: float, error: float
    ) -> list[tuple[Attempt, Attempt]]:
        """Return settings that do the same from new starts, with what they do; withdraw others."""
        seconds = self._measure.launch(self._request([each.settings for each in new], nrun=None))
        for late in new[len(seconds) :]:
            self._withdraw(late.settings, "no time to run them from new starts")
        confirmed = []
        for first, second in zip(new, seconds, strict=False):
            was_allowed = is_allowed(first, self._plan.max_error, first_error)
            if reason := self._why_not(first, second, was_allowed, error):
                self._withdraw(first.settings, reason)
            else:
                confirmed.append((first, second))
        return confirmed

    def _time_again(self, confirmed: Sequence[tuple[Attempt, Attempt]], first_error: float) -> None:
        if not confirmed:
            return
        self._advance(3, f"the time of {len(confirmed)} settings", 0.6)
        settings = [first.settings for first, _ in confirmed]
        rule = SettingRule(
            len(settings), LEAST_LAUNCHES, MOST_FINAL_LAUNCHES, self._end_s(1.0), self._clock
        )
        try:
            self._launch(settings, rule)
        finally:  # Ctrl-C, or a crash, leaves what has enough launches
            self._decide(confirmed, rule, first_error)

    def _decide(
        self, confirmed: Sequence[tuple[Attempt, Attempt]], rule: SettingRule, first_error: float
    ) -> None:
        for position, (first, second) in enumerate(confirmed):
            of_setting = rule.attempts.get(position, [])
            has_failed = bool(of_setting) and of_setting[-1].status != Status.OK
            if len(of_setting) < LEAST_LAUNCHES and not has_failed:
                continue
            again = with_figures(second, of_setting)
            if again.ratio is None or not saves_time(again.ratio):
                self._withdraw(
                    first.settings, again.detail or "not certainly faster from new starts"
                )
                continue
            was_allowed = is_allowed(first, self._plan.max_error, first_error)
            self._recommend(first, second, again.ratio, again.launches, was_allowed)
        by_effect = sorted(
            self._record.front, key=lambda each: (each.effect.rank, -each.ratio.estimate)
        )
        self._set(front=by_effect)

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
            return f"an {_too_far(error_of(second), allowed_error(limit, present_error))}"
        if not was_allowed and error_of(second) > MOST_ERROR:
            return f"an {_too_far(error_of(second), MOST_ERROR)}"
        return ""

    # -- launches -----------------------------------------------------------------------------

    @property
    def _timed_s(self) -> float:
        return min(MOST_TIMED_S, max(LEAST_TIMED_S, TIMED_SHARE * self._plan.budget_s))

    def _request(
        self,
        settings: Sequence[Settings],
        timed_s: float = 0.0,
        nrun: int | None = 0,
        end: float = 1.0,
        has_stages: bool = False,
    ) -> SettingLaunchRequest:
        stop_after_s = self._end_s(end) - self._clock()
        seed = self._rng.randrange(2**31)
        return SettingLaunchRequest(settings, timed_s, nrun, seed, has_stages, stop_after_s)

    def _launched(
        self,
        settings: Sequence[Settings],
        least: int,
        most: int,
        end: float,
        cut: float | None = None,
    ) -> list[list[Attempt]]:
        """Return the launches of each setting that was begun, in the order of `settings`.

        Args:
          end: share of the budget at which they end.
          cut: share at which a launch begins no other setting; then settings leave that seem
            slower. None for neither.
        """
        rule = SettingRule(len(settings), least, most, self._end_s(end), self._clock)
        if cut is not None:
            rule.stays = _is_hopeful
        self._launch(settings, rule, cut)
        return [rule.attempts[position] for position in sorted(rule.attempts)]

    def _launch(
        self, settings: Sequence[Settings], rule: SettingRule, cut: float | None = None
    ) -> None:
        """Launch settings as a rule says; it has their attempts, however this ends."""

        def left_s() -> float:
            return math.inf if cut is None else self._end_s(cut) - self._clock()

        targets = SettingTargets(self._measure.launch, settings, self._timed_s, left_s, self._rng)
        ending = launches.launch(targets, rule)
        if ending.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        if ending.status != Status.OK:
            raise MachineError(ending.detail)

    def _set(self, **changes: Any) -> None:
        self._record = replace(self._record, **changes)

    def _note(self, attempt: Attempt) -> None:
        name = label(attempt.settings)
        others = [each for each in self._record.attempts if label(each.settings) != name]
        self._set(attempts=[*others, attempt])

    def _recommend(
        self,
        first: Attempt,
        second: Attempt,
        ratio: Ratio,
        samples: Sequence[LaunchRow],
        is_allowed: bool = True,
    ) -> None:
        both = [each.error for each in (first, second) if each.error is not None]
        effects = [each.accuracy.effect for each in (first, second) if each.accuracy]
        accuracy = second.accuracy
        if accuracy is not None and first.accuracy is not None:
            sensor_share = max(accuracy.sensor_share, first.accuracy.sensor_share)
            accuracy = replace(accuracy, sensor_share=sensor_share)
        recommendation = Recommendation(
            first.settings,
            ratio,
            functools.reduce(Distance.larger, both) if len(both) == 2 else None,
            samples,
            max(effects, key=lambda effect: effect.rank, default=Effect.APPROXIMATE),
            accuracy,
            is_allowed,
        )
        self._set(front=[*self._record.front, recommendation])

    def _withdraw(self, settings: Sequence[Setting], reason: str) -> None:
        self._set(withdrawn=[*self._record.withdrawn, Withdrawal(settings, reason)])

    def _end_s(self, share: float) -> float:
        """Return when a part ends, by the clock: at a share of the budget, but not at once."""
        of_plan_s = self._begin_s + share * self._plan.budget_s
        return max(of_plan_s, self._clock() + LEAST_PART * self._plan.budget_s)

    def _has_time(self, share: float) -> bool:
        return self._clock() - self._begin_s < share * self._plan.budget_s


def _too_far(error: float, limit: float) -> str:
    return (
        f"error of {100 * error:.2g} % of the motion from new starts, where"
        f" {100 * limit:.2g} % is allowed"
    )


def _fastest(attempts: Sequence[Attempt], exact: bool) -> list[Attempt]:
    of_kind = [each for each in attempts if (effect_of(each) != Effect.APPROXIMATE) == exact]
    return sorted(of_kind, key=pareto_front.time_ratio_of)[:MOST_ALONE]


def _is_hopeful(attempts: Sequence[Attempt]) -> bool:
    ratio = together_known(attempts).time_ratio
    return ratio is not None and ratio < 1 + MOST_LOSS
