"""How many change points of simulated histories are detected, and how many listed ones are wrong.

    python -m benchmarks.studies.history_simulation [--histories 1000]

draws histories of a model whose truth is known, looks for changes as `mjbench history` does, and
writes docs/method/history-errors.md. It takes about a minute.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.studies import simulated_histories
from benchmarks.studies.simulated_histories import PLANS, RELEASES, Plan, Score
from mjbench.pages.markdown import table_lines
from mjbench.status import ExitCode

PAGE = Path(__file__).resolve().parents[2] / "docs" / "method" / "history-errors.md"
HISTORIES = 1000


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--histories", type=int, default=HISTORIES, help="of each kind")
    options = parser.parse_args(arguments)
    scores = {plan: simulated_histories.score(plan, options.histories) for plan in PLANS}
    PAGE.write_text("\n".join(_page(scores)) + "\n", encoding="utf-8")
    return ExitCode.OK


def _page(scores: dict[Plan, Score]) -> Iterator[str]:
    histories = next(iter(scores.values())).histories
    yield "# Which change points of a history are detected, simulated\n"
    yield "Written by `python -m benchmarks.studies.history_simulation`; do not edit.\n"
    yield _conclusion(scores) + "\n"
    yield (
        f"Each line is {histories:,} histories of {RELEASES} releases, with three change points at"
        " random releases, up or down (two where there is a drift). A listed one is right if it is"
        " at the very release and in the right direction; a release off, it counts as wrong. So a"
        " change that may well be a release earlier or later is not listed."
        " Changes are listed from 1 % on, so a true one of 1 % is listed about every second time.\n"
    )
    yield _noise() + "\n"
    yield from _table(scores)
    yield (
        "\n*Named*: listed as a drift that covers more than half of its releases. *Outliers*: 2 %"
        " of the releases have a further error, normally distributed with a deviation of 1 %, which"
        " the standard error does not include. *Understated*: the noise is twice as large as the"
        " standard error says."
    )


def _conclusion(scores: dict[Plan, Score]) -> str:
    worst = max(s.false_discoveries for plan, s in scores.items() if plan.changes)
    idle = max(s.wrong / s.histories for plan, s in scores.items() if not plan.changes)
    noisiest = max(plan.deviation or 0.0 for plan in scores)
    return (
        "In simulated histories with two or three true change points, at most"
        f" {100 * worst:.1f} % of the listed ones are wrong, up to a standard error of"
        f" {100 * noisiest:g} % of a release's ratio. Where nothing changes, there are at most"
        f" {idle:.3f} wrong ones in the history of a model."
    )


def _noise() -> str:
    averaged, shipped = (
        100 * float(np.sqrt(np.mean(simulated_histories.no_change_log_ratios(as_shipped) ** 2)))
        for as_shipped in (False, True)
    )
    return (
        "Where a line names no deviation, the error of each release's ratio is drawn from the"
        " [no-change pairs](selfcheck.md#no-change-pairs). Between these, the 40 measured log"
        f" ratios have a root mean square of {averaged:.2f} % with placement averaged out, and of"
        f" {shipped:.1f} % as shipped."
    )


def _table(scores: dict[Plan, Score]) -> Iterator[str]:
    numbers = ("detected, %", "wrong, of those listed, %", "wrong in a history", "drifts named, %")
    rows = (
        (
            plan.name,
            f"{100 * score.power:.1f}" if score.planted else "",
            f"{100 * score.false_discoveries:.1f}" if score.planted else "",
            f"{score.wrong / score.histories:.3f}",
            f"{100 * score.named / score.drifts:.1f}" if score.drifts else "",
        )
        for plan, score in scores.items()
    )
    return table_lines(["history of a model", *numbers], rows, right_aligned=numbers)


if __name__ == "__main__":
    sys.exit(main())
