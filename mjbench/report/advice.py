"""Which path to use on a model: the fastest for open loop, and the fastest for closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from mjbench.report.results import PathResult

# Of paths this close to the fastest, advice prefers the one listed first: the simpler one.
CLOSE_ENOUGH = 0.99


class Loop(StrEnum):
    """Where controls come from."""

    OPEN = "open"
    """They are known before the run."""
    CLOSED = "closed"
    """A policy chooses each from the state before it."""


@dataclass(frozen=True)
class Advice:
    """The path to use on one model, at one size.

    Attributes:
      model: its name.
      nbatch: simulations.
      loop: for which the advice holds.
      path: the way of stepping.
      options: of the path.
      speedup: over the plain loop; None where that was not timed.
      snippet: Python that does what the path does.
    """

    model: str
    nbatch: int | None
    loop: Loop
    path: str
    options: Mapping[str, Any]
    speedup: float | None
    snippet: str


def advise(results: Sequence[PathResult]) -> list[Advice]:
    """Return the advice for each model and size.

    Candidates are paths that were timed to the end: those that could not be the fastest were left
    out of the last rounds. Paths whose steps could not be judged are no candidates.
    """
    advice = []
    for group in dict.fromkeys(map(_group, results)):
        timed = [r for r in results if _group(r) == group and r.step_ns and r.is_judged]
        for loop in Loop:
            able = [r for r in timed if loop == Loop.OPEN or r.closed_loop]
            max_rounds = max((r.rounds for r in able if not r.is_accelerated), default=0)
            able = [r for r in able if r.is_accelerated or r.rounds == max_rounds]
            if able:
                advice.append(_advice(loop, able))
    return advice


def _advice(loop: Loop, able: Sequence[PathResult]) -> Advice:
    fastest = max(result.rate for result in able)
    best = next(result for result in able if result.rate >= CLOSE_ENOUGH * fastest)
    return Advice(
        model=best.model,
        nbatch=best.nbatch,
        loop=loop,
        path=best.path,
        options=best.options,
        speedup=best.speedup.median if best.speedup else None,
        snippet=best.snippet,
    )


def _group(result: PathResult) -> tuple[str, int | None]:
    return result.model, result.nbatch_asked
