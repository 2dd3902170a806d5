"""Which path to use on a model, for open and for closed loop, and on how many threads."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from mjbench import formats, paths
from mjbench.formats import count_of
from mjbench.interval import Interval
from mjbench.paired.race_record import MARGIN, Loop, RaceRecord, Standing
from mjbench.paths import BASE
from mjbench.paths.base import nthread
from mjbench.results.json_form import in_json
from mjbench.simulation import engine_clock
from mjbench.verification.plan import Variant, describe_options

if TYPE_CHECKING:  # results have their advice
    from mjbench.commands.compare.results import ModelResults, PathResult

# A number of threads is enough where it reaches this share of the best speed-up.
ENOUGH = 0.95
# Of two numbers, one and all cores, the table says it all.
_LEAST_COUNTS = 3
# Paths that a sentence names as perhaps faster, at most.
_MOST_RIVALS = 2
_LOOPS = {
    Loop.OPEN: "For controls known beforehand (open loop)",
    Loop.CLOSED: "For RL (closed loop)",
}


class Reason(StrEnum):
    """Why a path is advised."""

    FASTER = "faster"
    """It is the fastest, and certainly faster than the plain loop."""
    LIKELY = "likely"
    """It is the fastest by estimate, but not certainly faster than the plain loop."""
    SIMPLER = "simpler"
    """It is as good as the fastest, within `AS_GOOD`, and simpler."""
    NO_GAIN = "no gain"
    """It is the plain loop, and no path is likely to be faster."""
    ALONE = "alone"
    """It is the plain loop; no other path was timed for this loop."""
    PAYS = "pays"
    """It compiles, and what that takes pays within the steps asked for."""


# Why paths are advised that no race has compared with others.
_UNRIVALLED = (Reason.ALONE, Reason.PAYS)


@in_json(
    *("model", "nbatch", "loop", "path", "options", "speedup", "reason", "is_certain"),
    *("rivals", "most_gain", "unable", "break_even", "difference"),
    *("realtime_factor", "snippet"),
    **{name: f"result.{name}" for name in ("model", "difference", "realtime_factor")},
    nbatch="result.nbatch",
    rivals="rival_variants",
)
@dataclass(frozen=True)
class Advice:
    """The path to use on one model, at one size.

    Attributes:
      result: of the path.
      is_certain: whether no other path can be faster by `MARGIN`, and nothing disturbed the race.
      rivals: results of paths that may be as fast, the fastest by estimate first.
      most_gain: share by which one of them may be faster than the fastest, at most; None where
        launches are too few to say.
      unable: paths that left the race because they could not go on, or that are not advised because
        they take seconds to start, each with the reason.
      break_even: when compiling pays for an accelerated path that is faster, in one line; empty
        without one.
    """

    loop: Loop
    result: "PathResult"
    reason: Reason
    is_certain: bool
    rivals: Sequence["PathResult"] = ()
    most_gain: float | None = None
    unable: Sequence[str] = ()
    break_even: str = ""

    @property
    def path(self) -> str:
        return self.result.path

    @property
    def options(self) -> Mapping[str, Any]:
        return self.result.options

    @property
    def variant(self) -> Variant:
        """The path with its options."""
        return self.result.variant

    @property
    def speedup(self) -> Interval | None:
        """Over the plain loop, the same as in the path's row; None of the plain loop itself."""
        return self.result.interval

    @property
    def snippet(self) -> str:
        return self.result.snippet

    @property
    def rival_variants(self) -> list[Variant]:
        return [each.variant for each in self.rivals]


@dataclass(frozen=True)
class ClockAdvice:
    """What turning MuJoCo's timer off gains on one model, for every path and both loops."""

    model: str
    nbatch: int | None
    speedup: Interval
    snippet: str = engine_clock.OFF_SNIPPET


@dataclass(frozen=True, kw_only=True)
class ThreadAdvice:
    """How many threads a path should have on a model.

    Attributes:
      nthread: the smallest number of threads that has `ENOUGH` of the best speed-up; 1 where no
        number is certainly faster than one thread.
      most_tried: the largest number that was tried.
      over_one: speed-up of `nthread` threads over one; None for one thread.
      chunk: simulations that a thread takes at a time; None for the path's own number.
      is_certain: whether the race had the time that it needed, and nothing disturbed it.
    """

    model: str
    nbatch: int | None
    path: str
    nthread: int
    most_tried: int
    over_one: Interval | None
    chunk: int | None
    is_certain: bool


def advise(model_results: "ModelResults") -> list[Advice]:
    """Return the advice on a model at one size, for open and for closed loop.

    Paths whose steps could not be judged are no candidates. There is no advice without a race, and
    none for open loop where each call takes one control and all paths are for closed loop (--rl).
    """
    race, base = model_results.race, model_results.base
    if race is None or base is None:
        return []
    advice = []
    model = model_results.model
    is_rl = model.nstep == model.hold and all(each.closed_loop for each in model_results.results)
    for loop, standing in race.standings.items():
        if is_rl and loop == Loop.OPEN:
            continue
        choice = Advice(loop, base, Reason.ALONE, is_certain=not model_results.disturbances)
        if any(
            result.is_timed and result.serves(loop) and result.is_judged and result.path != BASE
            for result in model_results.results
        ):
            choice = _choose(model_results, race, loop, standing, base)
        choice = _with_accelerated(choice, model_results)
        advice.append(replace(choice, unable=_unable(model_results, race, choice)))
    return advice


def advise_clock(model_results: "ModelResults") -> ClockAdvice | None:
    """Return what turning MuJoCo's timer off gains, where that is certain and worth a line."""
    gain = model_results.race.timer_gain if model_results.race is not None else None
    if gain is None:
        return None
    return ClockAdvice(model_results.model.model, model_results.model.nbatch, gain)


def _choose(
    model_results: "ModelResults",
    race: RaceRecord,
    loop: Loop,
    standing: Standing,
    base: "PathResult",
) -> Advice:
    winner = race.winner(standing)
    chosen = model_results.timed(race.variants[winner]) or base
    has_figures = race.has_final_figures(chosen.variant)
    is_certain = standing.is_decided and has_figures and not model_results.disturbances
    is_simpler = winner == standing.chosen != standing.fastest
    reason = Reason.SIMPLER if is_simpler else Reason.FASTER
    if race.advised(standing) != winner:
        gain = chosen.speedup
        is_certain &= gain is not None and gain.high is not None and gain.high <= 1 + MARGIN
        chosen, reason = base, Reason.NO_GAIN
    elif chosen == base and reason == Reason.FASTER:
        reason = Reason.NO_GAIN
    elif chosen != base and not (chosen.speedup and chosen.speedup.is_above(1.0)):
        reason, is_certain = Reason.LIKELY, False
    contenders = (model_results.timed(race.variants[i]) for i in standing.contenders)
    rivals = [each for each in contenders if each is not None and each not in (chosen, base)]
    rivals.sort(key=lambda result: result.steps_per_s or 0.0, reverse=True)
    most_gain = standing.most_gain if math.isfinite(standing.most_gain) else None
    return Advice(loop, chosen, reason, is_certain, rivals, most_gain)


def _unable(model_results: "ModelResults", race: RaceRecord, choice: Advice) -> list[str]:
    """Return the paths that may be faster and are not advised, each with the reason."""
    results = {str(result.variant): result for result in model_results.results}
    unable = [
        f"{result.variant} left: {each.detail}"
        for each in race.unable
        if (result := results.get(str(race.variants[each.variant]))) and result.serves(choice.loop)
    ]
    slow = (model_results.timed(race.variants[i]) for i in race.slow)
    unable += [
        f"{result.variant} is faster, but takes seconds to start"
        for result in slow
        if result is not None and result.serves(choice.loop) and result.rate_over(choice.result) > 1
    ]
    return unable


def _with_accelerated(choice: Advice, model_results: "ModelResults") -> Advice:
    """Return an accelerated path instead where compiling it pays; otherwise say when it would.

    Compiling pays once its total time is below that of the chosen path and of its rivals.
    """
    displaced = max([choice.result, *choice.rivals], key=lambda result: result.steps_per_s or 0.0)
    total_steps, step_ns = model_results.total_steps, displaced.step_ns or 0.0
    faster = [
        result
        for result in model_results.results
        if result.compile_s is not None and result.is_timed and result.is_judged
        if result.serves(choice.loop) and result.rate_over(displaced) > 1 + MARGIN
    ]
    if not faster or total_steps is None:
        return choice
    paying = [each for each in faster if each.pays_after_steps(step_ns) <= total_steps]
    if paying:
        best = max(paying, key=lambda result: result.steps_per_s or 0.0)
        text = f"compiling pays after {best.pays_after_steps(step_ns):,.0f} steps"
        return Advice(choice.loop, best, Reason.PAYS, is_certain=False, break_even=text)
    first = min(faster, key=lambda result: result.pays_after_steps(step_ns))
    break_even = (
        f"{first.variant} would pay after {first.pays_after_steps(step_ns):,.0f} steps;"
        " --total-steps says how many you will take"
    )
    return replace(choice, break_even=break_even)


def advise_threads(model_results: "ModelResults") -> list[ThreadAdvice]:
    """Return the advice on each path of which one thread and two other numbers were timed."""
    race = model_results.race
    if race is None:
        return []
    timed = [r for r in model_results.results if r.is_timed and not r.is_accelerated]
    advice = []
    for name in dict.fromkeys(result.path for result in timed):
        own = [result for result in timed if result.path == name]
        counts = {nthread(result.options) for result in own}
        if len(counts) >= _LEAST_COUNTS and 1 in counts:
            advice.append(_thread_advice(race, own))
    return advice


def _thread_advice(race: RaceRecord, own: Sequence["PathResult"]) -> ThreadAdvice:
    fastest: dict[int, PathResult] = {}
    for result in own:
        count = nthread(result.options)
        if count not in fastest or result.rate_over(fastest[count]) > 1:
            fastest[count] = result
    best = max(fastest.values(), key=lambda result: result.steps_per_s or 0.0)
    enough = min(n for n, result in fastest.items() if result.rate_over(best) >= ENOUGH)
    over_one = race.ratio(fastest[enough].variant, fastest[1].variant) if enough > 1 else None
    if over_one is None or not over_one.is_above(1.0):
        enough, over_one = 1, None
    chosen = fastest[enough]
    return ThreadAdvice(
        model=chosen.model,
        nbatch=chosen.nbatch,
        path=chosen.path,
        nthread=enough,
        most_tried=max(fastest),
        over_one=over_one,
        chunk=chosen.options.get("chunk"),
        is_certain=race.is_decided and not (race.is_cut_short or chosen.disturbances),
    )


def conclusion(advice: Advice, names_size: bool = False) -> str:
    """Return which path to use, and why; `names_size`: for how many simulations."""
    gain = f", {formats.as_fast(advice.speedup)}" if advice.speedup is not None else ""
    begin = f"{_LOOPS[advice.loop]}{_size(advice.result.nbatch, names_size)}"
    is_open = not advice.is_certain and advice.reason not in _UNRIVALLED
    path = f"{'probably ' if is_open else ''}{described(advice.variant)}{gain}"
    if is_open and advice.reason == Reason.NO_GAIN:
        path = "no path is certainly faster than the plain loop"
    return "; ".join([f"{begin}: {path}", *_reasons(advice)])


def _size(nbatch: int | None, names_size: bool) -> str:
    return f", {count_of(nbatch, 'simulation')}" if names_size and nbatch else ""


def described(variant: Variant) -> str:
    """Return a path with its options for a sentence, such as `Batch.step on 2 threads`.

    Options that have the path's own value are left out. A path that is not one of mjbench's has
    its name.
    """
    path, options = paths.shipped(variant.path), dict(variant.options)
    if path is None:
        return str(variant)
    text = path.title or path.name
    for option in path.options:
        if option.name not in options:
            continue
        if option.name == "threads":
            text += f" on {count_of(options.pop(option.name), 'thread')}"
        elif option.is_parallel:
            text = f"{options.pop(option.name)} {text}"
        elif option.values and options[option.name] == option.values[0]:
            del options[option.name]
    rest = describe_options(options)
    return f"{text} ({rest})" if rest else text


def _reasons(advice: Advice) -> list[str]:
    reasons = []
    match advice.reason:
        case Reason.SIMPLER | Reason.NO_GAIN if advice.is_certain:
            reasons.append(f"no other path is faster by {formats.whole_percent(MARGIN)}")
        case Reason.ALONE:
            reasons.append("no other path was timed for it")
    reasons += filter(None, [_doubt(advice)])
    if advice.result.difference:
        reasons.append(f"close to C, not the same: {advice.result.difference}")
    return [*reasons, *advice.unable, *filter(None, [advice.break_even])]


def _doubt(advice: Advice) -> str:
    """Return which paths may be faster than the one that is advised, and by how much."""
    if advice.is_certain or advice.reason in _UNRIVALLED or not advice.rivals:
        return ""
    rivals = f"{len(advice.rivals)} other paths"
    if len(advice.rivals) <= _MOST_RIVALS:
        rivals = " or ".join(map(described, advice.rival_variants))
    most = f" by up to {max(1, round(100 * advice.most_gain))} %" if advice.most_gain else ""
    return f"{rivals} may be faster{most}"


def thread_conclusion(row: ThreadAdvice, names_size: bool = False) -> str:
    begin = f"{paths.title(row.path)}{_size(row.nbatch, names_size)}:"
    doubt = "" if row.is_certain else "; not certain"
    if row.over_one is None:
        most = row.most_tried
        return f"{begin} no number of threads up to {most} is certainly faster than one{doubt}"
    is_most = row.nthread == row.most_tried
    more = "" if is_most else f"; up to {row.most_tried} threads gain less than 5 % more"
    chunk = f" (chunk={row.chunk})" if row.chunk else ""
    gain = formats.as_fast(row.over_one)
    return f"{begin} {row.nthread} threads are enough{chunk}, {gain} as one thread{more}{doubt}"


def clock_conclusion(clock: ClockAdvice, names_size: bool = False) -> str:
    begin = f"Any path{_size(clock.nbatch, names_size)}: turn off {engine_clock.TIMER_NAME}"
    return f"{begin} ({engine_clock.OFF_CODE}), {formats.as_fast(clock.speedup)}"
