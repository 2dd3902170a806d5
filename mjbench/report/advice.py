"""Which path to use on a model: for open loop, and for closed loop. It follows from the race."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from mjbench.comparison.plan import WITHOUT_TIMER, Variant
from mjbench.instrument.ratio import Ratio
from mjbench.paired.race_record import MARGIN, RaceRecord, Standing
from mjbench.paths import BASE
from mjbench.report.results import ModelResults, PathResult
from mjbench.simulation import package_timer


class Loop(StrEnum):
    """Where controls come from."""

    OPEN = "open"
    """They are known before the run."""
    CLOSED = "closed"
    """A policy chooses each from the state before it."""


class Reason(StrEnum):
    """Why a path is advised."""

    FASTER = "faster"
    """It is the fastest, and certainly faster than the plain loop."""
    SIMPLER = "simpler"
    """It is as good as the fastest, within 2 %, and simpler."""
    NO_GAIN = "no gain"
    """It is the plain loop, and no path is certainly faster."""
    ALONE = "alone"
    """It is the plain loop; no other path was timed for this loop."""
    PAYS = "pays"
    """It compiles, and what that takes pays within the steps asked for."""


@dataclass(frozen=True)
class Advice:
    """The path to use on one model, at one size.

    Attributes:
      model: its name.
      nbatch: simulations.
      loop: for which the advice holds.
      path: the way of stepping.
      options: of the path.
      speedup: over the plain loop, the same as in the path's row; None for the plain loop itself.
      reason: why.
      is_certain: whether no other path can be faster by 2 %, and nothing disturbed the race.
      rivals: paths that may be as fast, each with its options, the fastest by estimate first.
      most_gain: share by which one of them may be faster than the fastest, at most; None where
        launches are too few to say.
      unable: paths that left the race because they could not go on, or that are not advised because
        they take seconds to start, each with the reason.
      break_even: when compiling pays for an accelerated path that is faster, in one line; empty
        without one.
      realtime_factor: simulated seconds per second, all simulations together.
      snippet: Python that does what the path does.
    """

    model: str
    nbatch: int | None
    loop: Loop
    path: str
    options: Mapping[str, Any]
    speedup: Ratio | None
    reason: Reason
    is_certain: bool
    rivals: Sequence[Variant]
    most_gain: float | None
    unable: Sequence[str]
    break_even: str
    realtime_factor: float | None
    snippet: str


@dataclass(frozen=True)
class ClockAdvice:
    """What turning MuJoCo's timer off gains on one model, for every path and both loops.

    Attributes:
      model: its name.
      nbatch: simulations.
      speedup: of the plain loop.
      snippet: Python that turns it off.
    """

    model: str
    nbatch: int | None
    speedup: Ratio
    snippet: str = package_timer.OFF_SNIPPET


@dataclass(frozen=True)
class _Choice:
    """A path that follows from what is known.

    Attributes:
      result: of the path.
      reason: why.
      is_certain: see `Advice`.
      rivals: likewise.
      most_gain: likewise.
      break_even: likewise.
    """

    result: PathResult
    reason: Reason
    is_certain: bool
    rivals: Sequence[Variant] = ()
    most_gain: float | None = None
    break_even: str = ""


def advise(model_results: ModelResults) -> list[Advice]:
    """Return the advice on a model at one size, for open and for closed loop.

    Paths whose steps could not be judged are no candidates. There is no advice without a race, as
    in files of earlier versions.
    """
    race = model_results.race
    if race is None:
        return []
    advice = []
    for loop, place in zip(Loop, race.standings(), strict=True):
        base = model_results.base
        if place is None or base is None:
            continue
        choice = _choose(model_results, race, place, base)
        if not _others_timed(model_results, loop):
            choice = _Choice(base, Reason.ALONE, is_certain=True)
        choice = _with_accelerated(choice, model_results)
        advice.append(_advice(loop, choice, _unable(model_results, race, loop, choice)))
    return advice


def advise_clock(model_results: ModelResults) -> ClockAdvice | None:
    """Return what turning MuJoCo's timer off gains, where that is certain and worth a line."""
    race = model_results.race
    gain = race.speedup(WITHOUT_TIMER) if race is not None else None
    if gain is None or not gain.is_above(1.0) or gain.estimate < 1 + package_timer.MIN_GAIN:
        return None
    return ClockAdvice(model_results.model.model, model_results.model.nbatch, gain)


def _choose(
    model_results: ModelResults, race: RaceRecord, place: Standing, base: PathResult
) -> _Choice:
    """Return the C path to use of those that compete with each other."""
    by_variant = {str(result.variant): result for result in model_results.results}
    chosen = by_variant.get(str(race.variants[place.chosen]), base)
    is_certain = place.is_decided and race.has_figures_after and not model_results.disturbances
    reason = Reason.SIMPLER if place.fastest != place.chosen else Reason.FASTER
    gain = chosen.speedup
    if chosen.variant == base.variant:
        reason = Reason.SIMPLER if place.fastest != place.chosen else Reason.NO_GAIN
    elif gain is None or not gain.is_above(1.0):
        is_certain &= gain is not None and gain.high is not None and gain.high <= 1 + MARGIN
        chosen, reason = base, Reason.NO_GAIN
    others = (race.variants[i] for i in {place.fastest, place.chosen, *place.rivals})
    rivals = [
        result
        for variant in others
        if (result := by_variant.get(str(variant))) and result.variant != chosen.variant
    ]
    rivals.sort(key=lambda result: result.steps_per_s or 0.0, reverse=True)
    most_gain = place.most_gain if math.isfinite(place.most_gain) else None
    return _Choice(chosen, reason, is_certain, [result.variant for result in rivals], most_gain)


def _others_timed(model_results: ModelResults, loop: Loop) -> bool:
    """Return whether a path other than the plain loop was timed that a loop can use."""
    return any(
        loop == Loop.OPEN or result.closed_loop
        for result in model_results.results
        if result.is_timed and result.is_judged and result.path != BASE
    )


def _unable(
    model_results: ModelResults, race: RaceRecord, loop: Loop, choice: _Choice
) -> list[str]:
    """Return the paths that may be faster and are not advised, each with the reason."""
    unable = [f"{race.variants[each.variant]} left: {each.detail}" for each in race.unable]
    slow = {str(race.variants[i]) for i in race.slow}
    unable += [
        f"{r.variant} is faster, but takes seconds to start"
        for r in model_results.results
        if str(r.variant) in slow
        and r.is_timed
        and (loop == Loop.OPEN or r.closed_loop)
        and r.rate_over(choice.result) > 1
    ]
    return unable


def _with_accelerated(choice: _Choice, model_results: ModelResults) -> _Choice:
    """Return an accelerated path instead where compiling it pays; otherwise say when it would."""
    timed = [r for r in model_results.results if r.is_accelerated and r.is_timed and r.is_judged]
    faster = [r for r in timed if r.rate_over(choice.result) > 1 + MARGIN]
    total_steps = model_results.total_steps
    if not faster or total_steps is None:
        return choice
    best = max(faster, key=lambda result: result.steps_per_s or 0.0)
    pays_after = best.overtakes_after_steps
    if pays_after is not None and pays_after <= total_steps:
        text = f"compiling pays after {pays_after:,.0f} steps"
        return _Choice(best, Reason.PAYS, is_certain=False, break_even=text)
    if pays_after is None:
        return choice
    break_even = (
        f"{best.variant} would pay after {pays_after:,.0f} steps; --total-steps says how many you"
        " will take"
    )
    return replace(choice, break_even=break_even)


def _advice(loop: Loop, choice: _Choice, unable: Sequence[str]) -> Advice:
    result = choice.result
    is_base = choice.reason in (Reason.NO_GAIN, Reason.ALONE) or result.path == BASE
    return Advice(
        model=result.model,
        nbatch=result.nbatch,
        loop=loop,
        path=result.path,
        options=result.options,
        speedup=None if is_base else result.speedup,
        reason=choice.reason,
        is_certain=choice.is_certain,
        rivals=choice.rivals,
        most_gain=choice.most_gain,
        unable=unable,
        break_even=choice.break_even,
        realtime_factor=result.realtime_factor,
        snippet=result.snippet,
    )
