"""Which settings to try together, and which of them are worth a second look."""

import itertools
import math
from collections.abc import Sequence

from mjbench.commands.tune.result import Attempt, Effect, Limits
from mjbench.commands.tune.settings import NO_CHANGE, Setting, Settings

# Recommendations at most; approximate settings that are tried in pairs.
FRONT, FEW = 6, 4
# A point of the front takes at most this share of the time of the one before it; one with an error
# larger than allowed, this share.
DISTINCT, DISTINCT_BEYOND = 0.98, 0.9


def combinations(faster: Sequence[Attempt]) -> list[Settings]:
    """Return settings to try together, one of each knob; those most likely to help first.

    They are the fastest of each knob among the free settings, among those and the equivalent ones,
    and among all; and each other setting, and each pair of the fastest few, with all that cost no
    accuracy. None is a setting alone.
    """
    free = [each for each in faster if effect_of(each) == Effect.FREE]
    exact = [each for each in faster if effect_of(each) != Effect.APPROXIMATE]
    others = [each for each in faster if effect_of(each) == Effect.APPROXIMATE]
    others = sorted(others, key=time_ratio_of)
    chosen = [_fastest_by_knob(group) for group in (free, exact, faster)]
    chosen += [_fastest_by_knob([each], exact) for each in others]
    chosen += [_fastest_by_knob(pair, exact) for pair in itertools.combinations(others[:FEW], 2)]
    return list(dict.fromkeys(each for each in chosen if len(each) > 1))


def _fastest_by_knob(*groups: Sequence[Attempt]) -> Settings:
    """Return a setting of each knob: of the first group that has one, the fastest.

    The settings of the loop exclude each other.
    """
    by_knob: dict[str, Setting] = {}
    for group in groups:
        for each in sorted(group, key=lambda each: each.ratio.estimate if each.ratio else 1.0):
            (setting,) = each.settings
            by_knob.setdefault(setting.knob if setting.loop == NO_CHANGE else "loop", setting)
    return tuple(setting for _, setting in sorted(by_knob.items()))


def pareto_front(
    attempts: Sequence[Attempt], limits: Limits, present_error: float
) -> list[Attempt]:
    """Return the attempts worth a second look, the smallest effect first.

    They are the fastest free one, the fastest equivalent one if it is faster, and approximate ones
    that are faster still, from the most accurate on; with the fastest one that is within the error
    allowed.
    """
    front: list[Attempt] = []
    allowed = [each for each in attempts if is_allowed(each, limits, present_error)]
    for effect in (Effect.FREE, Effect.EQUIVALENT):
        of_effect = [each for each in allowed if effect_of(each) == effect]
        if of_effect:
            _add_if_faster(front, min(of_effect, key=time_ratio_of))
    approximate = [each for each in attempts if effect_of(each) == Effect.APPROXIMATE]
    within = [each for each in approximate if each in allowed]
    if within:
        _add_if_faster(front, min(within, key=time_ratio_of))
    beyond = [each for each in approximate if each not in allowed]
    for each in sorted(beyond, key=lambda each: (error_of(each), time_ratio_of(each))):
        _add_if_faster(front, each, DISTINCT_BEYOND)
    return front[:FRONT]


def is_allowed(attempt: Attempt, limits: Limits, present_error: float) -> bool:
    """Return whether error and change of settings are no larger than allowed.

    What changes no state is always allowed; what is equivalent, unless the user sets a limit.
    """
    effect = effect_of(attempt)
    if effect == Effect.FREE or (effect == Effect.EQUIVALENT and not limits.are_set):
        return True
    is_near = change_of(attempt) <= limits.allowed_change
    return is_near and error_of(attempt) <= limits.allowed_error(present_error)


def _add_if_faster(front: list[Attempt], attempt: Attempt, factor: float = DISTINCT) -> None:
    if time_ratio_of(attempt) < factor * (time_ratio_of(front[-1]) if front else 1.0):
        front.append(attempt)


def effect_of(attempt: Attempt) -> Effect:
    assert attempt.accuracy is not None, "it did not fail"
    return attempt.accuracy.effect


def error_of(attempt: Attempt) -> float:
    """Return the error of settings that did not fail, as a share of the motion.

    Without a reference, it is 0 for those that do not change the motion, and unknown for others.
    """
    if attempt.error is not None:
        return attempt.error.share
    return math.inf if effect_of(attempt) == Effect.APPROXIMATE else 0.0


def change_of(attempt: Attempt) -> float:
    """Return how far settings that did not fail take the motion, as a share of it."""
    assert attempt.accuracy is not None, "it did not fail"
    return attempt.accuracy.distance.share


def time_ratio_of(attempt: Attempt) -> float:
    """Return the time of settings over that of the present ones; infinity where they failed."""
    return math.inf if attempt.time_ratio is None else attempt.time_ratio
