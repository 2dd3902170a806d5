"""What docs/results.md has of the tally of `benchmarks.studies.tuning`."""

import statistics
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from benchmarks.studies.page_part import PagePart
from mjbench.commands.tune.result import NO_ERROR, Effect
from mjbench.status import Status

if TYPE_CHECKING:
    from benchmarks.studies.tuning import Promise, TunedModel, TuningTally

_HEADINGS = ("model", "same results", "within tolerance", "error allowed")
PART = PagePart("results.md", "tuning", "benchmarks.studies.tuning")


def row(model: "TunedModel") -> str:
    """Return the row of a model in the table."""
    if model.status != Status.OK:
        return f"| {model.model} | {model.status}: {model.detail} | | |"
    return f"| {model.model} | {' | '.join(map(_gain, gains_of(model)))} |"


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


def lines(tally: "TuningTally") -> Iterator[str]:
    """Yield the conclusion, a row for each model, and how often promises held."""
    searched = [model for model in tally.models if model.status == Status.OK]
    medians = (statistics.median(gains) for gains in zip(*map(gains_of, searched), strict=True))
    gain, exact, best = medians
    yield (
        f"MuJoCo {tally.mujoco} on {tally.processor}, {tally.budget_s:g} s a model. On the median"
        f" of {len(searched)} models a simulated second became {gain:.2f} times as fast with the"
        f" same results, {exact:.2f} times within the solver's tolerance, and {best:.2f} times with"
        f" an error no larger than the model has now or than {100 * NO_ERROR:g} % of the motion."
        " Each column includes the columns before it."
    )
    yield ""
    yield f"| {' | '.join(_HEADINGS)} |"
    yield "|---|---:|---:|---:|"
    yield from map(row, tally.models)
    yield ""
    promises = [promise for model in searched for promise in model.promises]
    first = [promise for promise in promises if promise.is_best]
    nrun = max((promise.later_nrun for promise in promises), default=0)
    free, equivalent = promises_kept(tally)
    yield (
        f"Each listed setting then ran {nrun} times from new starts. Nine in ten of these runs"
        f" erred by no more than promised for {_errors_hold(first)} settings that were recommended"
        f" first, and for {_errors_hold(promises)} in all. Free settings changed no state in {free}"
        f" cases. Equivalent settings stayed equivalent in {equivalent}."
    )


def promises_kept(tally: "TuningTally") -> tuple[str, str]:
    """Return how many settings changed no more than promised, of how many: free, equivalent."""
    promises = [promise for model in tally.models for promise in model.promises]
    free, equivalent = (
        [promise.keeps_effect for promise in promises if promise.effect == effect]
        for effect in (Effect.FREE, Effect.EQUIVALENT)
    )
    return f"{sum(free)} of {len(free)}", f"{sum(equivalent)} of {len(equivalent)}"


def _errors_hold(promises: Sequence["Promise"]) -> str:
    """Return how many of some promises about errors hold."""
    return f"{sum(promise.keeps_error for promise in promises)} of {len(promises)}"
