"""How many change points of simulated histories are detected, and how many listed ones are wrong.

    python -m benchmarks.studies.history_simulation [--histories 1000]

draws histories of a model whose truth is known, looks for changes as `benchmarks.history` does, and
writes a part of docs/method/history.md. It takes about a minute.
"""

import sys
from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.studies import simulated_histories, tally_command
from benchmarks.studies.page_part import PagePart
from benchmarks.studies.simulated_histories import PLANS, RELEASES, Plan, Score
from mjbench.results.markdown import table_lines
from mjbench.status import ExitCode

PART = PagePart("method/history.md", "history-errors", "benchmarks.studies.history_simulation")
HISTORIES = 1000


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--histories", type=int, default=HISTORIES, help="of each kind")
    options = parser.parse_args(arguments)
    scores = {plan: simulated_histories.score(plan, options.histories) for plan in PLANS}
    PART.write(_lines(scores))
    return ExitCode.OK


def _lines(scores: dict[Plan, Score]) -> Iterator[str]:
    histories = next(iter(scores.values())).histories
    yield _conclusion(scores)
    yield ""
    yield (
        f"Each line is {histories:,} histories of {RELEASES} releases, with three changes at random"
        " releases, up or down (two where there is a drift). A listed change is right if it is at"
        " the very release and in the right direction. Changes are listed from 1 % on, so a true"
        " one of 1 % is listed about every second time."
    )
    yield ""
    yield _noise()
    yield ""
    yield from _table(scores)
    yield ""
    yield (
        "*Named*: listed as a drift that covers more than half of its releases. *Outliers*: 2 % of"
        " the releases have a further error, with a deviation of 1 %. *Understated*: the noise is"
        " twice as large as the standard error."
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
        " [no-change pairs](errors.md#what-is-tried). Between these, the 40 measured log"
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
