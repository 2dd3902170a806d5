"""Search settings that make a model faster in C: each alone, the best together, a second look.

1. Every setting is timed alone, the likely gains first, in two fresh processes. Those that seem
   faster are run from a few starts, to see whether they change anything, and timed again in further
   processes, which give the figures.
2. Those that are certainly faster are run from all starts. The reference, which says by how much
   they err, is run only where some of them change the motion.
3. The best of them are run together, from all starts.
4. The front, on which no settings are both faster and more accurate than others, is measured again
   from starts and with controls that the search has not seen. What that does not confirm is
   withdrawn.
"""

import math
import random
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mjbench.commands.tune import knobs, pareto_front, setting_names
from mjbench.commands.tune.measurements import CMeasurements, summary, with_accuracy, with_figures
from mjbench.commands.tune.pareto_front import change_of, effect_of, error_of, is_allowed
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
# Shares of the budget: computing of the survey, and of the reference; and when screening ends, the
# figures of each setting, their errors, and combinations.
SURVEY_SHARE, REFERENCE_SHARE = 0.04, 0.1
SCREEN_END, FIGURES_END, ERRORS_END, TOGETHER_END = 0.3, 0.5, 0.65, 0.75
# A part that begins late takes at most this share of the budget.
LEAST_PART = 0.1
# Launches that choose settings; that give figures, at least and at most; of the second look, too.
SCREENS, LEAST_LAUNCHES, MOST_LAUNCHES, MOST_FINAL_LAUNCHES = 2, 4, 8, 16
# Seconds of timing of a setting in a launch, as a share of the budget, at least and at most.
TIMED_SHARE, LEAST_TIMED_S, MOST_TIMED_S = 0.002, 0.03, 0.2
# A launch of a few settings takes at least this share of the time of one of all: it starts a
# process.
SHARE_OF_START = 0.25
# Runs that show whether a setting changes anything.
FEW_NRUN = 8
# Settings that get figures of their own: of those that change no motion, and of the others.
MOST_ALONE = 10


# Called with how many parts of the search are done, what goes on, and a share of 0.
Advance = Callable[[int, str, float], None]
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      budget_s: seconds of the whole search, about; with less than a minute, some settings may have
        no error, and nothing may be confirmed by a second look.
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

    _reference_s = 0.0

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

    def result(self) -> TuneRecord:
        try:
            alone = self._judged(self._timed(self._screened(self._survey())))
            together = self._together([each for each in alone if not each.gives_up])
            self._look_again(together)
        except MjbenchError as error:
            self._set(status=failure_of(error).status, detail=self._detail_of(error))
        except KeyboardInterrupt:
            self._set(status=Status.INTERRUPTED)
        return replace(self._record, seconds=self._clock() - self._begin_s)

    def _detail_of(self, error: MjbenchError) -> str:
        return failure_of(error).detail.removeprefix(f"{self._record.model}: ")

    # -- each setting alone -------------------------------------------------------------------

    def _survey(self) -> list[Settings]:
        """Run the present settings; return what there is to try, the likely gains first."""
        plan = self._plan
        self._advance(0, "what there is to try", 0.0)
        computing_s = min(MAX_COMPUTING_S, SURVEY_SHARE * plan.budget_s)
        settings, meshes = self._measure.survey(plan.seed, computing_s)
        self._advance(0, "the present settings", 0.5)
        present, stages, collision, self._reference_s = self._measure.present(plan.trials(0))
        self._set(meshes=meshes, present=present, stages=stages, collision=collision)
        wanted = [each for each in settings if each.knob in plan.knobs]
        return [(each,) for each in sorted(wanted, key=lambda s: -knobs.likely_gain(s, stages))]

    def _screened(self, settings: Sequence[Settings]) -> list[Attempt]:
        """Time each setting; return those that may be faster, and change what they may."""
        self._advance(1, f"{len(settings)} settings", 0.0)
        launched: dict[Settings, list[Attempt]] = {}
        self._launch(settings, launched, 1, SCREENS, SCREEN_END, FIGURES_END)
        timed = self._noted(map(summary, launched.values()))
        promising = [
            each
            for each in timed
            if each.time_ratio is not None and each.time_ratio <= 1 - LEAST_GAIN
        ]
        self._advance(1, f"what {len(promising)} settings change", 0.3)
        seen = self._noted_run(promising, FIGURES_END, nrun=FEW_NRUN)
        self._leave_untried(len(settings) - len(timed) + len(promising) - len(seen))
        allowed = [each for each in seen if self._may_change_so_much(each)]
        return [*_fastest(allowed, exact=True), *_fastest(allowed, exact=False)]

    def _timed(self, promising: Sequence[Attempt]) -> list[Attempt]:
        """Time settings in launches that did not choose them; return the certainly faster ones."""
        self._advance(1, f"the time of {len(promising)} settings", 0.5)
        settings = [each.settings for each in promising]
        launched: dict[Settings, list[Attempt]] = {}
        self._launch(settings, launched, LEAST_LAUNCHES, MOST_LAUNCHES, FIGURES_END)
        timed = self._noted(with_figures(each, launched[each.settings]) for each in promising)
        return [each for each in timed if each.ratio and saves_time(each.ratio)]

    def _judged(self, faster: Sequence[Attempt]) -> list[Attempt]:
        """Run settings from all starts; return those that do what they may."""
        if any(self._needs_error(each) for each in faster):
            self._advance(1, "the reference", 0.7)
            self._set(present=self._reference() or self._present)
        self._advance(1, f"the error of {len(faster)} settings", 0.8)
        judged = self._noted_run(faster, ERRORS_END, has_stages=True)
        late = faster[len(judged) :]  # there was no time to run them from all starts
        allowed = [each for each in late if self._may_be(each)]
        self._leave_untried(len(late) - len(allowed))
        return [*allowed, *(each for each in judged if self._may_be(each))]

    # -- together -----------------------------------------------------------------------------

    def _together(self, alone: Sequence[Attempt]) -> list[Attempt]:
        """Return settings alone, and those of their combinations that do what they may."""
        chosen = pareto_front.combinations(alone)
        self._advance(2, f"{len(chosen)} combinations", 0.0)
        tried = [] if self._is_over else self._run(chosen, TOGETHER_END, timed_s=self._timed_s)
        self._set(untried_combinations=len(chosen) - len(tried))
        return [*alone, *self._noted(each for each in tried if self._may_be(each))]

    # -- second look --------------------------------------------------------------------------

    def _look_again(self, attempts: Sequence[Attempt]) -> None:
        """Measure the front again, from starts and with controls that the search has not seen.

        Where settings are withdrawn, those that come next are measured, while there is time.
        """
        first_error = self._present.tolerated_error
        if not (front := self._front(attempts, first_error)):
            return
        if self._is_over:
            for each in front:
                self._withdraw(each.settings, "no time to run them from new starts")
            return
        error = self._present_again(any(self._needs_error(each) for each in attempts))
        if self._record.no_reference:
            for each in filter(self._needs_error, front):
                reason = f"no reference from new starts: {self._record.no_reference}"
                self._withdraw(each.settings, reason)
            attempts = [each for each in attempts if not self._needs_error(each)]
            front = self._front(attempts, first_error)
        confirmed: dict[Settings, tuple[Attempt, Attempt]] = {}
        while front:
            self._advance(3, f"{len(front)} settings from new starts", 0.3)
            again = self._run([each.settings for each in front], 1.0)
            for late in front[len(again) :]:
                self._withdraw(late.settings, "no time to run them from new starts")
            for first, second in zip(front, again, strict=False):
                if reason := self._why_not(first, second, first_error, error):
                    self._withdraw(first.settings, reason)
                else:
                    confirmed[first.settings] = first, second
            if self._is_over:
                break
            front = [
                each
                for each in self._front(attempts, first_error)
                if each.settings not in confirmed
            ]
        self._advance(3, f"the time of {len(confirmed)} settings", 0.6)
        launched: dict[Settings, list[Attempt]] = {}
        try:
            self._launch([*confirmed], launched, LEAST_LAUNCHES, MOST_FINAL_LAUNCHES, 1.0)
        finally:  # Ctrl-C, or a crash, leaves what has enough launches
            for settings, looks in confirmed.items():
                self._recommend(*looks, launched.get(settings, ()), first_error)

    def _front(self, attempts: Sequence[Attempt], error: float) -> list[Attempt]:
        withdrawn = {each.settings for each in self._record.withdrawn}
        left = [each for each in attempts if each.settings not in withdrawn]
        return pareto_front.pareto_front(left, self._plan.limits, error)

    def _present_again(self, needs_error: bool) -> float:
        """Run the present settings, and the reference, from new starts; return the error there."""
        first = self._present
        self._advance(3, "present settings from new starts", 0.0)
        present, *_ = self._measure.present(self._plan.trials(1, first.ncontrol))
        if first.error is None:
            self._set(present=present)
        elif needs_error:
            present = self._reference(first.horizon_ncontrol) or present
            if present.error is not None:
                self._set(present=replace(present, error=first.error.larger(present.error)))
        return present.tolerated_error

    def _why_not(self, first: Attempt, second: Attempt, first_error: float, error: float) -> str:
        """Return why new starts do not confirm what settings do; empty where they do.

        Args:
          error: of the present settings, tolerated from new starts; `first_error` in the search.
        """
        if second.accuracy is None:
            return second.detail
        was, now, limits = effect_of(first), effect_of(second), self._plan.limits
        if now.rank > was.rank:
            return f"{was} in the search, {now} from new starts"
        is_judged = is_allowed(first, limits, first_error)
        if is_judged and is_allowed(second, limits, error):
            return ""
        most_error = limits.allowed_error(error) if is_judged else MOST_ERROR
        for name, share, most in (
            ("a change", change_of(second), limits.allowed_change),
            ("an error", error_of(second), most_error),
        ):
            if share > most:
                return (
                    f"{name} of {100 * share:.2g} % of the motion from new starts, where"
                    f" {100 * most:.2g} % is allowed"
                )
        return ""

    def _recommend(
        self, first: Attempt, second: Attempt, launched: Sequence[Attempt], first_error: float
    ) -> None:
        """Recommend settings that both looks confirm, or withdraw them, if launches are enough."""
        if len(launched) < LEAST_LAUNCHES and all(each.status == Status.OK for each in launched):
            return
        again = with_figures(second, launched)
        if again.ratio is None or not saves_time(again.ratio):
            self._withdraw(first.settings, again.detail or "not certainly faster from new starts")
            return
        assert first.accuracy is not None and second.accuracy is not None, "neither failed"
        accuracy = replace(
            second.accuracy,
            sensor_share=max(second.accuracy.sensor_share, first.accuracy.sensor_share),
            distance=second.accuracy.distance.larger(first.accuracy.distance),
        )
        recommendation = Recommendation(
            first.settings,
            again.ratio,
            first.error.larger(second.error) if first.error and second.error else None,
            again.launches,
            first.accuracy.effect,
            accuracy,
            is_allowed(first, self._plan.limits, first_error),
        )
        front = [*self._record.front, recommendation]
        self._set(front=sorted(front, key=lambda each: (each.effect.rank, -each.ratio.estimate)))

    def _withdraw(self, settings: Settings, reason: str) -> None:
        self._set(withdrawn=[*self._record.withdrawn, Withdrawal(settings, reason)])

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
        """Run the reference; None where it fails or there is no time, which the record says."""
        begin_s = self._clock()
        left_s = self._end_s(1.0) - begin_s
        if self._reference_s > left_s:
            self._set(
                no_reference=f"it takes about {plain(self._reference_s, 2)} s, and"
                f" {plain(left_s, 2)} s were left"
            )
            return None
        try:
            return self._measure.reference(horizon_ncontrol)
        except (InputError, MachineError) as error:
            self._set(no_reference=self._detail_of(error))
            return None
        finally:  # on a busy machine it takes longer than its steps say
            self._reference_s = max(self._reference_s, self._clock() - begin_s)

    # -- launches -----------------------------------------------------------------------------

    @property
    def _timed_s(self) -> float:
        return min(MOST_TIMED_S, max(LEAST_TIMED_S, TIMED_SHARE * self._plan.budget_s))

    def _request(
        self, settings: Sequence[Settings], end_s: float, **what: Any
    ) -> SettingLaunchRequest:
        seed, stop_after_s = self._rng.randrange(2**31), end_s - self._clock()
        return SettingLaunchRequest(settings, seed=seed, stop_after_s=stop_after_s, **what)

    def _run(
        self, settings: Sequence[Settings], end: float, nrun: int | None = None, **what: Any
    ) -> list[Attempt]:
        """Run settings from all starts, or some; return those that were begun in time."""
        request = self._request(settings, self._end_s(end), nrun=nrun, **what)
        return self._measure.launch(request) if settings else []

    def _noted_run(self, attempts: Sequence[Attempt], end: float, **what: Any) -> list[Attempt]:
        """Run settings; return what was begun in time with what it does, which the record has."""
        seen = self._run([each.settings for each in attempts], end, **what)
        return self._noted(with_accuracy(*pair) for pair in zip(attempts, seen, strict=False))

    def _launch(
        self,
        settings: Sequence[Settings],
        launched: dict[Settings, list[Attempt]],
        least: int,
        most: int,
        end: float,
        cut: float = math.inf,
    ) -> None:
        """Time settings in fresh processes; add to the attempts of each that is begun.

        Settings that fail leave. Each launch but the first, which has the likely gains first, has
        an order of its own.

        Args:
          least: launches that are begun in any case.
          end: share of the budget; after the least, no launch is begun that would end later.
          cut: share at which a launch begins no other setting; then settings leave that seem
            slower.
        """
        left, launch_s, end_s, cut_s = settings, 0.0, self._end_s(end), self._end_s(cut)
        for number in range(most):
            begin_s = self._clock()
            if not left or (number >= least and begin_s + launch_s > end_s):
                return
            order = self._rng.sample(left, len(left)) if number else left
            attempts = self._measure.launch(self._request(order, cut_s, timed_s=self._timed_s))
            for attempt in attempts:
                launched.setdefault(attempt.settings, []).append(attempt)
            left = [
                each.settings
                for each in attempts
                if each.status == Status.OK
                and (cut_s == math.inf or _is_hopeful(launched[each.settings]))
            ]
            share = max(len(left) / len(order), SHARE_OF_START)
            launch_s = share * (self._clock() - begin_s)

    def _set(self, **changes: Any) -> None:
        self._record = replace(self._record, **changes)

    def _noted(self, attempts: Iterable[Attempt]) -> list[Attempt]:
        """Return attempts, each of which is in the record in place of an earlier one."""
        new = list(attempts)
        names = {label(each.settings) for each in new}
        others = [each for each in self._record.attempts if label(each.settings) not in names]
        self._set(attempts=[*others, *new])
        return new

    def _leave_untried(self, count: int) -> None:
        self._set(untried=self._record.untried + count)

    @property
    def _is_over(self) -> bool:
        return self._clock() - self._begin_s >= self._plan.budget_s

    def _end_s(self, share: float) -> float:
        """Return when a part ends, by the clock: at a share of the budget, but not at once."""
        of_plan_s = self._begin_s + share * self._plan.budget_s
        return max(of_plan_s, self._clock() + LEAST_PART * self._plan.budget_s)


def _fastest(attempts: Sequence[Attempt], exact: bool) -> list[Attempt]:
    of_kind = [each for each in attempts if (effect_of(each) != Effect.APPROXIMATE) == exact]
    return sorted(of_kind, key=pareto_front.time_ratio_of)[:MOST_ALONE]


def _is_hopeful(attempts: Sequence[Attempt]) -> bool:
    ratio = summary(attempts).time_ratio
    return ratio is not None and ratio < 1 + MOST_LOSS
