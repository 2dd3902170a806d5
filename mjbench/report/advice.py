"""Which path to use on a model: for open loop, and for closed loop.

Blocks of one process show which paths may be the fastest; these are then compared in fresh
processes (`paired.contest`). `contest_groups` names them, `advise` the path that follows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from mjbench.comparison.plan import MAY_BE_FASTEST, Variant
from mjbench.paired.confirmation import MIN_EFFECT, ConfirmationRecord
from mjbench.paired.contest import ContestRecord
from mjbench.paired.records import Ratio
from mjbench.paths import BASE
from mjbench.report.results import ModelResults, PathResult
from mjbench.simulation import package_timer
from mjbench.status import Status

# The options of the plain loop without the timer of MuJoCo's Python package.
CLOCK_OFF = {"clock": "off"}
# Paths that are not compared in fresh processes, and so not advised, with the reason.
NOT_CONTESTED = {"ray": "Ray takes too long to start in fresh processes"}


class Loop(StrEnum):
    """Where controls come from."""

    OPEN = "open"
    """They are known before the run."""
    CLOSED = "closed"
    """A policy chooses each from the state before it."""


class Reason(StrEnum):
    """Why a path is advised."""

    FASTER = "faster"
    """It is certainly faster than the plain loop."""
    SIMPLER = "simpler"
    """It is simpler than the fastest path, which is faster by less than 3 %."""
    NO_GAIN = "no gain"
    """It is the plain loop, and no path is certainly faster."""
    ALONE = "alone"
    """It is the plain loop; no other path was timed for this loop."""
    UNCONFIRMED = "unconfirmed"
    """It is the plain loop; the paths that may be faster were not compared again."""
    PAYS = "pays"
    """It compiles, and what that takes pays within the steps asked for."""


@dataclass(frozen=True)
class Advice:
    """The path to use on one model, at one size.

    Attributes:
      speedup: over the plain loop; None for the plain loop itself.
      low: lower end of its 95 % interval, from process to process; None where it has none.
      rival: path and options that seem faster, or hardly are; empty without one.
      detail: why the rival could not be compared again, in one line; empty without.
      unable: paths that may be the fastest and could not run in fresh processes, each with the
        reason.
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
    speedup: float | None
    low: float | None
    high: float | None
    reason: Reason
    rival: str
    detail: str
    unable: Sequence[str]
    break_even: str
    realtime_factor: float | None
    snippet: str


@dataclass(frozen=True)
class ClockAdvice:
    """What turning MuJoCo's timer off gains on one model, for every path and both loops.

    Attributes:
      speedup: of the plain loop.
      low: lower end of its 95 % interval, from process to process.
      snippet: Python that turns it off.
    """

    model: str
    nbatch: int | None
    speedup: float
    low: float
    high: float
    snippet: str = package_timer.OFF_SNIPPET


@dataclass(frozen=True)
class Pairing:
    """Two paths to compare again.

    Attributes:
      baseline: the simpler one.
      candidate: the one that seems faster.
      min_effect: smallest difference that matters.
    """

    baseline: Variant
    candidate: Variant
    min_effect: float = MIN_EFFECT


@dataclass(frozen=True)
class _Choice:
    """A path that follows from what is known, or the comparison that is missing.

    Attributes:
      ratio: its time over the plain loop's, in fresh processes; None without.
      rival: a C path that seems faster.
      detail: why that could not be compared again.
      unable: paths that could not, each with the reason.
      break_even: when compiling pays for an accelerated path that is faster.
    """

    result: PathResult
    reason: Reason
    ratio: Ratio | None = None
    rival: PathResult | None = None
    detail: str = ""
    unable: Sequence[str] = ()
    break_even: str = ""


def clock_pairing(model_results: ModelResults) -> Pairing | None:
    """Return the comparison with and without MuJoCo's timer, where it is still needed."""
    facts = model_results.model.facts
    has_clock = facts is not None and bool(facts.has_clock)
    was_compared = any(map(_is_of_clock, model_results.confirmations))
    if has_clock and not was_compared and _able(model_results):
        return Pairing(Variant(BASE, {}), Variant(BASE, CLOCK_OFF), package_timer.MIN_GAIN)
    return None


def contest_groups(model_results: ModelResults) -> list[list[Variant]]:
    """Return the variants to compare in fresh processes, for each loop; none where all were.

    The plain loop is in every group. A loop in which nothing else may be the fastest has no group.
    """
    if model_results.contest is not None:
        return []
    groups = [[_variant(r) for r in _contenders(able)] for able in _able(model_results).values()]
    return [group for group in groups if len(group) > 1]


def advise(model_results: ModelResults) -> list[Advice]:
    """Return the advice on a model at one size, for open and for closed loop.

    Candidates are paths that were timed to the end: those that could not be the fastest were left
    out of the last rounds. Paths whose steps could not be judged are no candidates. There is no
    advice where the plain loop was not timed.
    """
    advice = []
    for loop, able in _able(model_results).items():
        choice = _choose(able, model_results.contest)
        choice = replace(
            choice, unable=[*choice.unable, *_not_contested(model_results, loop, choice)]
        )
        if not _others_timed(model_results, loop):
            choice = replace(choice, reason=Reason.ALONE)
        if choice.reason == Reason.UNCONFIRMED and _is_of_earlier_version(model_results):
            choice = replace(choice, detail="an earlier version of mjbench compared it otherwise")
        accelerated = [r for r in model_results.results if r.is_accelerated and _is_able(r)]
        choice = _with_accelerated(choice, accelerated, model_results.total_steps)
        advice.append(_advice(loop, choice))
    return advice


def advise_clock(model_results: ModelResults) -> ClockAdvice | None:
    """Return what turning MuJoCo's timer off gains, where that is certain and worth a line."""
    for record in filter(_is_of_clock, model_results.confirmations):
        ratio = record.ratio
        if ratio is None or not is_certainly_faster(ratio, 1 / (1 + package_timer.MIN_GAIN)):
            continue
        assert ratio.low and ratio.high, "what is certain has an interval"
        model = model_results.model
        return ClockAdvice(
            model.model, model.nbatch, 1 / ratio.estimate, 1 / ratio.high, 1 / ratio.low
        )
    return None


def _is_of_clock(record: ConfirmationRecord) -> bool:
    return (record.baseline, record.candidate) == (BASE, BASE)


def _is_of_earlier_version(model_results: ModelResults) -> bool:
    """Return whether paths were compared two at a time, in place of a contest."""
    pairs = [record for record in model_results.confirmations if not _is_of_clock(record)]
    return bool(pairs) and model_results.contest is None


def _able(model_results: ModelResults) -> dict[Loop, list[PathResult]]:
    """Return the C paths that may be advised, by loop; without a plain loop there are none.

    What follows is compared again in fresh processes, which some paths are not (NOT_CONTESTED).
    """
    timed = [r for r in model_results.results if _is_able(r) and not r.is_accelerated]
    timed = [r for r in timed if (r.path, r.options) != (BASE, CLOCK_OFF)]
    timed = [r for r in timed if r.path not in NOT_CONTESTED]
    if not any(result.path == BASE for result in timed):
        return {}
    able = {}
    for loop in Loop:
        of_loop = [r for r in timed if loop == Loop.OPEN or r.closed_loop or r.path == BASE]
        max_rounds = max(r.rounds for r in of_loop)
        able[loop] = [r for r in of_loop if r.rounds == max_rounds or r.path == BASE]
    return able


def _not_contested(model_results: ModelResults, loop: Loop, choice: _Choice) -> list[str]:
    """Return the paths that may be faster and are never compared again, each with the reason."""
    return [
        f"{_variant(r)}: {NOT_CONTESTED[r.path]}"
        for r in model_results.results
        if r.path in NOT_CONTESTED
        and _is_able(r)
        and (loop == Loop.OPEN or r.closed_loop)
        and r.rate > choice.result.rate
    ]


def _others_timed(model_results: ModelResults, loop: Loop) -> bool:
    """Return whether a path other than the plain loop was timed that a loop can use."""
    others = (r for r in model_results.results if r.path != BASE and _is_able(r))
    return any(loop == Loop.OPEN or r.closed_loop for r in others)


def _is_able(result: PathResult) -> bool:
    return result.step_ns is not None and result.is_judged


def _contenders(able: Sequence[PathResult]) -> list[PathResult]:
    """Return the plain loop and the paths that may be the fastest, from the simplest on."""
    fastest = max(result.rate for result in able)
    return [r for r in able if r.path == BASE or r.rate >= MAY_BE_FASTEST * fastest]


def _choose(able: Sequence[PathResult], contest: ContestRecord | None) -> _Choice:
    """Return the path to use of those that are able."""
    contenders = _contenders(able)
    base = next(result for result in contenders if result.path == BASE)
    if len(contenders) == 1:
        return _Choice(base, Reason.NO_GAIN)
    seems = max(contenders, key=lambda result: result.rate)
    unconfirmed = _Choice(base, Reason.UNCONFIRMED, rival=seems if seems is not base else None)
    if contest is None or contest.detail or contest.status != Status.OK:
        return replace(unconfirmed, detail=contest.detail if contest else "")
    reasons = [contest.why_unable(_variant(result)) for result in contenders]
    unable = [f"{_variant(r)}: {why}" for r, why in zip(contenders, reasons, strict=True) if why]
    compared = [r for r, why in zip(contenders, reasons, strict=True) if not why]
    if base not in compared or len(compared) == 1:
        return replace(unconfirmed, unable=unable)
    return replace(_winner(compared, base, contest), unable=unable)


def _winner(compared: Sequence[PathResult], base: PathResult, contest: ContestRecord) -> _Choice:
    """Return the path to use of those that were compared in a contest, `base` among them."""
    variants = [_variant(result) for result in compared]
    fastest = compared[variants.index(contest.fastest(variants))]
    chosen = compared[variants.index(contest.choice(variants))]
    rival = None if chosen is fastest else fastest
    if chosen is base:
        return _Choice(base, Reason.SIMPLER if rival else Reason.NO_GAIN, rival=rival)
    ratio = contest.ratio(_variant(base), _variant(chosen))
    if not is_certainly_faster(ratio, 1.0):
        return _Choice(base, Reason.NO_GAIN, rival=chosen)
    return _Choice(chosen, Reason.SIMPLER if rival else Reason.FASTER, ratio, rival)


def is_certainly_faster(ratio: Ratio | None, most: float) -> bool:
    """Return whether the candidate's time is certainly shorter, and at most a share by estimate."""
    if ratio is None or ratio.high is None:
        return False
    return ratio.high < 1.0 and ratio.estimate <= most


def _with_accelerated(
    choice: _Choice, accelerated: Sequence[PathResult], total_steps: int | None
) -> _Choice:
    """Return an accelerated path instead where compiling it pays; otherwise say when it would."""
    faster = [r for r in accelerated if r.rate > (1 + MIN_EFFECT) * choice.result.rate]
    if not faster or total_steps is None:
        return choice
    best = max(faster, key=lambda result: result.rate)
    pays_after = best.overtakes_after_steps
    if pays_after is not None and pays_after <= total_steps:
        return _Choice(
            best, Reason.PAYS, break_even=f"compiling pays after {pays_after:,.0f} steps"
        )
    if pays_after is None:
        return choice
    break_even = (
        f"{_variant(best)} would pay after {pays_after:,.0f} steps; --total-steps says how many you"
        " will take"
    )
    return replace(choice, break_even=break_even)


def _advice(loop: Loop, choice: _Choice) -> Advice:
    result, ratio = choice.result, choice.ratio
    speedup = result.speedup.median if result.speedup and result.path != BASE else None
    return Advice(
        model=result.model,
        nbatch=result.nbatch,
        loop=loop,
        path=result.path,
        options=result.options,
        speedup=1 / ratio.estimate if ratio else speedup,
        low=1 / ratio.high if ratio and ratio.high else None,
        high=1 / ratio.low if ratio and ratio.low else None,
        reason=choice.reason,
        rival=str(_variant(choice.rival)) if choice.rival else "",
        detail=choice.detail,
        unable=choice.unable,
        break_even=choice.break_even,
        realtime_factor=result.realtime_factor,
        snippet=result.snippet,
    )


def _variant(result: PathResult) -> Variant:
    return Variant(result.path, result.options)
