"""The page docs/tuning.md, written from the tally of `benchmarks.studies.tuning`."""

import statistics
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from mjbench.commands.tune.result import NO_ERROR, Effect
from mjbench.status import Status

if TYPE_CHECKING:
    from benchmarks.studies.tuning import Promise, TunedModel, TuningTally

# When the search last changed; results of an earlier day are of another search.
_SEARCH_SINCE = "2026-11-28"
_HEADINGS = ("model", "same results", "within tolerance", "error allowed", "settings")


def page(tally: "TuningTally") -> str:
    """Return the Markdown page of a tally."""
    return "\n".join(_lines(tally)) + "\n"


def row(model: "TunedModel") -> str:
    """Return the row of a model in the table."""
    if model.status != Status.OK:
        return f"| {model.model} | {model.status}: {model.detail} | | | |"
    best = next((each for each in model.promises if each.is_best), None)
    settings = best.settings if best else "none is certainly faster"
    gains = [_gain(each) for each in gains_of(model)]
    return f"| {model.model} | {' | '.join(gains)} | {settings} |"


def gains_of(model: "TunedModel") -> list[float]:
    """Return the speed-ups of a model: with the same results, within tolerance, and the best.

    Each includes what changes less; it is 1 where nothing is recommended.
    """
    free = _best(model.promises, (Effect.FREE,))
    exact = max(free, _best(model.promises, (Effect.FREE, Effect.EQUIVALENT)))
    best = next((1 / each.time_ratio for each in model.promises if each.is_best), 1.0)
    return [free, exact, max(exact, best)]


def _best(promises: Sequence["Promise"], effects: Sequence[Effect]) -> float:
    """Return the largest speed-up among promises of some effects; 1 without any."""
    return max((1 / each.time_ratio for each in promises if each.effect in effects), default=1.0)


def _gain(speedup: float) -> str:
    return f"{speedup:.2f}×" if speedup > 1 else "–"


def _lines(tally: "TuningTally") -> Iterator[str]:
    searched = [model for model in tally.models if model.status == Status.OK]
    if not searched:
        yield "No model was searched to the end."
        return
    promises = [promise for model in searched for promise in model.promises]
    gain, exact, best = (
        statistics.median(values) for values in zip(*map(gains_of, searched), strict=True)
    )
    yield "# What tune gains"
    yield ""
    yield (
        "Written by `python -m benchmarks.studies.tuning` from `results/tuning.json`; do not edit."
    )
    yield ""
    yield (
        f"On the median of {len(searched)} models, `mjbench tune` makes a simulated second"
        f" {gain:.2f} times as fast with the same results, {exact:.2f} times within the solver's"
        " tolerance, and"
        f" {best:.2f} times with an error that is no larger than the model has now, or at most"
        f" {100 * NO_ERROR:g} % of the motion."
    )
    yield ""
    yield f"| {' | '.join(_HEADINGS)} |"
    yield "|---|---:|---:|---:|---|"
    yield from map(row, tally.models)
    yield ""
    yield (
        f"Searched until {tally.date} with MuJoCo {tally.mujoco} on {tally.processor}, with a"
        f" budget of {tally.budget_s:g} s a model. Each column includes what changes less. Settings"
        " are those recommended first. Ten models are mjbench's own, ten are of other packages."
    )
    if tally.date < _SEARCH_SINCE:
        yield ""
        yield (
            f"The search has changed since. These results are of the search of {tally.date}; run"
            " the command above to measure today's."
        )
    yield from _promise_lines(searched, promises)


def _promise_lines(
    searched: Sequence["TunedModel"], promises: Sequence["Promise"]
) -> Iterator[str]:
    """Yield whether what was promised holds from further starts."""
    yield ""
    yield "## Does it keep its promises?"
    yield ""
    first = [promise for promise in promises if promise.is_best]
    free = [promise for promise in promises if promise.effect == Effect.FREE]
    equivalent = [promise for promise in promises if promise.effect == Effect.EQUIVALENT]
    nrun = max((promise.later_nrun for promise in promises), default=0)
    yield (
        "Every row of the output was run again from starts that the search had not used:"
        f" {nrun} runs each. Nine in ten err by no more than promised for {_errors_hold(first)}"
        f" settings that are recommended first, and for {_errors_hold(promises)} of all that are"
        f" shown. Free settings changed no state in {_effects_hold(free)} cases; equivalent ones"
        f" were still equivalent in {_effects_hold(equivalent)}. The search itself withdrew"
        f" {sum(model.withdrawn for model in searched)} settings when it measured them again."
    )
    broken = [
        (m, p) for m in searched for p in m.promises if not (p.keeps_error and p.keeps_effect)
    ]
    if broken:
        yield ""
        yield from (_broken(model, promise) for model, promise in broken)


def _errors_hold(promises: Sequence["Promise"]) -> str:
    """Return how many of some promises about errors hold."""
    return f"{sum(promise.keeps_error for promise in promises)} of {len(promises)}"


def _effects_hold(promises: Sequence["Promise"]) -> str:
    """Return how many of some promises about effects hold."""
    return f"{sum(promise.keeps_effect for promise in promises)} of {len(promises)}"


def _broken(model: "TunedModel", promise: "Promise") -> str:
    parts = []
    if promise.error is not None and not promise.keeps_error:
        parts.append(
            f"{promise.later_exceeding} of {promise.later_nrun} runs err by more than"
            f" {100 * promise.error:.2g} % of the motion"
        )
    if not promise.keeps_effect:
        worst = max(promise.later_effects, key=lambda effect: effect.rank)
        parts.append(f"{worst} instead of {promise.effect} in one or both measurements")
    return f"- {model.model}: {promise.settings}: {'; '.join(parts)}"
