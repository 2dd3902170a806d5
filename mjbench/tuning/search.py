"""Search settings that make a model faster: each alone, then together, then a second look.

1. Every setting is tried alone, in a process of its own; those that seem faster are compared with
   the present settings in fresh processes.
2. Those that are faster are combined. Combinations are tried on few runs first; the better half
   goes on to more runs (successive halving: Jamieson and Talwalkar, AISTATS 2016).
3. The front, on which no setting is both faster and nearer to the reference than another, is
   measured again from starts and with controls that the search has not seen. What that does not
   confirm is withdrawn.
"""

import itertools
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning.attempts import Attempt, Effect
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
# An error of more than this is no simulation of the model any more, unless the present one is.
MOST_ERROR = 0.5
# Seconds that a comparison in fresh processes may take: of one setting, and in the second look.
SINGLE_S, FINAL_S = 10.0, 15.0
# Recommendations at most, and seconds that the second look at each takes at least.
FRONT, LEAST_FINAL_S = 6, 12.0
# Shares of the time before the second look after which no further setting is attempted alone, and
# none is compared alone.
ATTEMPTS_SHARE, SINGLES_SHARE = 0.5, 0.8
# Combinations that are tried; runs and quads of each in the first rung.
COMBINATIONS, RUNG_NRUN, RUNG_QUADS = 32, 8, 12
# A point of the front takes at most this share of the time of the one before it; one with an error
# larger than allowed, this share.
DISTINCT, DISTINCT_BEYOND = 0.98, 0.9

# Called with how many parts of the search are done, what goes on, and a share of 0.
Advance = Callable[[int, str, float], None]
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      starts: where start states are to come from.
      budget_s: seconds after which nothing is begun but the second look.
      max_error: the largest error allowed, as a share of the motion; None for the present one.
      only: the largest effect allowed.
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

    def trials(self, look: int, ncontrol: int | None = None) -> TrialPlan:
        """Return the starts and controls of a look: 0 for the search, 1 for the second look.

        Args:
          look: which one.
          ncontrol: controls of a run, where the horizon is known; None to look for it.
        """
        return TrialPlan(self.seed + look, self.starts, ncontrol, self.hold)


@dataclass(frozen=True)
class _Faster:
    """A setting that is faster alone."""

    setting: Setting
    effect: Effect
    ratio: float


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
        """Measure nothing yet.

        Args:
          model: its name.
          settings: to try.
          plan: of the search.
          measurements: what is measured, and how.
          advance: called when something begins.
          clock: returns seconds.
        """
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
        faster = self._each_alone()
        lossless = [each for each in faster if not each.setting.loses]
        front = pareto_front(self._together(lossless), plan.max_error, self._present.error.share)
        if front:
            self._second_look(front)

    def record(self, status: Status = Status.OK, detail: str = "") -> TuneRecord:
        """Return what was measured so far.

        Args:
          status: how the search ended.
          detail: why, in one line; empty when ok.
        """
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

    def _each_alone(self) -> list[_Faster]:
        """Try each setting alone; return those that are faster, and not worse than may be."""
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
        promising.sort(key=_rank)
        faster = []
        for number, attempt in enumerate(promising):
            if not self._has_time(SINGLES_SHARE):
                self._untried += len(promising) - number
                for left in promising[number:]:
                    self._note(left)
                break
            (setting,) = attempt.settings
            self._advance(1, setting.label, 0.5 + number / (2 * len(promising)))
            paired = self._measure.compare(attempt.settings, self._plan.seed, SINGLE_S)
            self._note(attempt, paired)
            if paired.is_faster and paired.ratio is not None and attempt.accuracy is not None:
                faster.append(_Faster(setting, attempt.accuracy.effect, paired.ratio.estimate))
        return faster

    def _is_promising(self, attempt: Attempt) -> bool:
        """Return whether settings may be faster, and do no more than is allowed."""
        if attempt.time_ratio is None or attempt.time_ratio > 1 - LEAST_GAIN:
            return False
        return self._is_allowed(attempt)

    def _is_allowed(self, attempt: Attempt) -> bool:
        """Return whether settings do to the motion what they may."""
        assert self._present is not None, "attempts follow the baseline"
        accuracy = attempt.accuracy
        if accuracy is None or accuracy.effect.rank > self._plan.only.rank:
            return False
        most = self._plan.max_error or max(MOST_ERROR, 2 * self._present.error.share)
        return accuracy.effect != Effect.APPROXIMATE or accuracy.error.share <= most

    def _note(self, attempt: Attempt, paired: PairedTime | None = None) -> None:
        """Note how settings did."""
        failed = paired is not None and paired.status != Status.OK
        self._rows.append(
            AttemptRow(
                attempt.settings,
                paired.status if failed and paired else attempt.status,
                paired.detail if failed and paired else attempt.detail,
                attempt.accuracy,
                attempt.time_ratio,
                paired.ratio if paired else None,
            )
        )

    # -- together -----------------------------------------------------------------------------

    def _together(self, faster: Sequence[_Faster]) -> list[Attempt]:
        """Try combinations of settings that are faster alone; return how the last ones did."""
        chosen = combinations(faster, COMBINATIONS, random.Random(self._plan.seed))
        exact = {each.setting.label for each in faster if each.effect != Effect.APPROXIMATE}
        nrun, quads, rung = RUNG_NRUN, RUNG_QUADS, 0
        while True:
            is_last = len(chosen) <= 2 * FRONT
            done = []
            for number, settings in enumerate(chosen):
                if not self._has_time() and rung > 0:
                    break
                self._advance(2, label(settings), number / len(chosen))
                if is_last:
                    done.append(self._measure.attempt(settings))
                    self._note(done[-1])
                else:
                    done.append(self._measure.attempt(settings, nrun, quads))
            able = [each for each in done if self._is_allowed(each)]
            if is_last or len(done) < len(chosen):
                return able
            # what changes less is recommended beside what is faster, so the two do not compete
            of_exact = [each for each in able if all(one.label in exact for one in each.settings)]
            others = [each for each in able if each not in of_exact]
            chosen = [each.settings for each in better_half(of_exact) + better_half(others)]
            nrun, quads, rung = 2 * nrun, 2 * quads, rung + 1

    # -- second look --------------------------------------------------------------------------

    def _second_look(self, front: Sequence[Attempt]) -> None:
        """Measure a front again, from starts and with controls that the search has not seen."""
        assert self._present is not None, "a front follows the baseline"
        plan = self._plan
        self._advance(3, "present settings from new starts", 0.0)
        ncontrol = self._present.horizon_ncontrol
        second_present = self._measure.baseline(plan.trials(1, ncontrol))
        error = self._present.error.larger(second_present.error)
        self._present = replace(second_present, error=error)
        for number, first in enumerate(front):
            self._advance(3, label(first.settings), number / len(front))
            second = self._measure.attempt(first.settings, quads=0)
            reason = why_not(first, second, self._present, plan)
            if not reason:
                paired = self._measure.compare(first.settings, plan.seed + 1, FINAL_S)
                reason = _why_not_faster(paired)
            if reason:
                self._withdrawn.append(Withdrawal(first.settings, reason))
                continue
            assert first.accuracy and second.accuracy and paired.ratio, "it was confirmed"
            self._front.append(
                Recommendation(
                    first.settings,
                    max(first.accuracy.effect, second.accuracy.effect, key=lambda e: e.rank),
                    paired.ratio,
                    first.accuracy.error.larger(second.accuracy.error),
                    second.accuracy,
                    paired.launches,
                )
            )

    def _has_time(self, share: float = 1.0) -> bool:
        """Return whether anything may begin before a share of the search, without its second look.

        Args:
          share: of the time before the second look.
        """
        reserved_s = min(FRONT * LEAST_FINAL_S, self._plan.budget_s / 2)
        return self._clock() - self._begin_s < share * (self._plan.budget_s - reserved_s)


def combinations(
    faster: Sequence[_Faster], most: int, rng: random.Random
) -> list[tuple[Setting, ...]]:
    """Return settings to try together, one of each knob at most; those most likely to help first.

    They are the fastest of each knob among the free settings, among those and the equivalent ones,
    and among all; each setting together with all that cost no accuracy; and random choices of the
    others.

    Args:
      faster: settings that are faster alone.
      most: number of combinations at most.
      rng: draws the random ones.
    """
    chosen: dict[frozenset[str], tuple[Setting, ...]] = {}

    def add(settings: Sequence[_Faster]) -> None:
        combination = _fastest_by_knob(settings)
        if combination:
            chosen.setdefault(frozenset(each.label for each in combination), combination)

    free = [each for each in faster if each.effect == Effect.FREE]
    exact = [each for each in faster if each.effect != Effect.APPROXIMATE]
    others = [each for each in faster if each.effect == Effect.APPROXIMATE]
    for group in (free, exact, faster):
        add(group)
    for each in faster:
        add([each])
    for each in others:
        add([other for other in exact if other.setting.knob != each.setting.knob] + [each])
    for one, two in itertools.combinations(others, 2):
        add([*_without(exact, one, two), one, two])
    for _ in range(4 * most if others else 0):
        sample = rng.sample(others, rng.randint(1, len(others)))
        add([*_without(exact, *sample), *sample])
    return list(chosen.values())[:most]


def _without(settings: Sequence[_Faster], *others: _Faster) -> list[_Faster]:
    """Return settings of other knobs than some have."""
    knobs = {each.setting.knob for each in others}
    return [each for each in settings if each.setting.knob not in knobs]


def _fastest_by_knob(settings: Sequence[_Faster]) -> tuple[Setting, ...]:
    """Return the fastest setting of each knob, in the order of their names.

    The loop's own settings exclude each other.
    """
    by_knob: dict[str, _Faster] = {}
    for each in sorted(settings, key=lambda each: each.ratio):
        knob = "loop" if each.setting.path_options else each.setting.knob
        by_knob.setdefault(knob, each)
    return tuple(each.setting for _, each in sorted(by_knob.items()))


def better_half(attempts: Sequence[Attempt]) -> list[Attempt]:
    """Return half of the attempts: front after front, each from the fastest on."""
    left, better = list(attempts), list[Attempt]()
    while left and 2 * len(better) < len(attempts):
        front = [one for one in left if not any(_dominates(other, one) for other in left)]
        better += sorted(front, key=_time_ratio)
        left = [one for one in left if one not in front]
    return better[: (len(attempts) + 1) // 2]


def pareto_front(
    attempts: Sequence[Attempt], max_error: float | None, present_error: float
) -> list[Attempt]:
    """Return the attempts worth a second look, the smallest effect first.

    They are the fastest free one, the fastest equivalent one if it is faster, and approximate ones
    that are faster still, from the most accurate on; with the fastest one that is within the error
    allowed.

    Args:
      attempts: on which all combinations are.
      max_error: the largest error allowed, as a share of the motion; None for the present one.
      present_error: of the present settings.
    """
    front: list[Attempt] = []
    for effect in (Effect.FREE, Effect.EQUIVALENT):
        of_effect = [each for each in attempts if _effect(each) == effect]
        if of_effect:
            _add_if_faster(front, min(of_effect, key=_time_ratio))
    approximate = [each for each in attempts if _effect(each) == Effect.APPROXIMATE]
    limit = allowed_error(max_error, present_error)
    within = [each for each in approximate if _error(each) <= limit]
    if within:
        _add_if_faster(front, min(within, key=_time_ratio))
    for each in sorted((e for e in approximate if _error(e) > limit), key=_error):
        _add_if_faster(front, each, DISTINCT_BEYOND)
    return front[:FRONT]


def _add_if_faster(front: list[Attempt], attempt: Attempt, factor: float = DISTINCT) -> None:
    """Add an attempt to a front, if it takes at most this share of the time of the last one."""
    if _time_ratio(attempt) < factor * (_time_ratio(front[-1]) if front else 1.0):
        front.append(attempt)


def why_not(first: Attempt, second: Attempt, present: Present, plan: SearchPlan) -> str:
    """Return why the second look does not confirm settings; empty where it does, by accuracy.

    Args:
      first: how they did in the search.
      second: how they do from new starts.
      present: the present settings from those starts.
      plan: of the search.
    """
    if second.accuracy is None:
        return second.detail
    assert first.accuracy is not None, "it is on the front"
    was, now = first.accuracy, second.accuracy
    if now.effect.rank > was.effect.rank:
        return f"{was.effect} in the search, {now.effect} from new starts"
    if was.effect != Effect.APPROXIMATE:
        return ""
    limit = allowed_error(plan.max_error, present.error.share)
    if now.error.share > limit >= was.error.share:
        return f"errs by {100 * now.error.share:.2g} % of the motion from new starts"
    return ""


def _why_not_faster(paired: PairedTime) -> str:
    """Return why fresh processes do not confirm that settings are faster; empty where they do."""
    if paired.is_faster:
        return ""
    return paired.detail or "not certainly faster from new starts"


def _rank(attempt: Attempt) -> tuple[int, float]:
    """Return what attempts are sorted by: their effect, then their time."""
    return _effect(attempt).rank, _time_ratio(attempt)


def _effect(attempt: Attempt) -> Effect:
    assert attempt.accuracy is not None, "it did not fail"
    return attempt.accuracy.effect


def _error(attempt: Attempt) -> float:
    assert attempt.accuracy is not None, "it did not fail"
    return attempt.accuracy.error.share


def _time_ratio(attempt: Attempt) -> float:
    assert attempt.time_ratio is not None, "it was timed"
    return attempt.time_ratio


def _dominates(one: Attempt, other: Attempt) -> bool:
    """Return whether one is as fast and as near as another, and better in one of the two."""
    pair = (_time_ratio(one), _error(one)), (_time_ratio(other), _error(other))
    return all(mine <= theirs for mine, theirs in zip(*pair, strict=True)) and pair[0] != pair[1]
