"""How many steps of simulated histories are found, and how many listed ones are wrong.

    python -m benchmarks.history_simulation [--histories 1000]

draws histories of a model whose truth is known, looks for changes as `mjbench history` does, and
writes docs/method/history-errors.md. It takes about a minute.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks import simulated_histories
from benchmarks.simulated_histories import NOISIEST, PLANS, RELEASES, Plan, Score
from mjbench.status import ExitCode

PAGE = Path(__file__).resolve().parent.parent / "docs" / "method" / "history-errors.md"
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
    noise = 100 * float(simulated_histories.no_change_log_ratios().std())
    certain = [s for plan, s in scores.items() if plan.steps and plan.deviation != NOISIEST]
    worst = max(score.false_discoveries for score in certain)
    (noisiest,) = (score for plan, score in scores.items() if plan.deviation == NOISIEST)
    yield "# Which steps of a history are found, simulated"
    yield ""
    yield "Written by `python -m benchmarks.history_simulation`; do not edit."
    yield ""
    yield (
        f"Of the steps that a history lists, at most {100 * worst:.1f} % are wrong, as long as a"
        " release's ratio has a standard error of at most 0.35 %. A step at a neighbouring release"
        f" counts as wrong, and as not found. Where the standard error is {100 * NOISIEST:g} %,"
        f" {100 * noisiest.false_discoveries:.1f} % are wrong."
    )
    yield ""
    yield (
        f"Each line is {histories:,} histories of {RELEASES} releases. Where no deviation is given,"
        f" noise is drawn from the [no-change pairs](selfcheck.md#no-change-pairs), whose estimates"
        f" have a standard deviation of {noise:.2f} %. Steps are listed from 1 % on, so a true step"
        " of 1 % is listed about every second time."
    )
    yield ""
    yield (
        "| history of a model | steps found, % | listed steps that are wrong, % |"
        " wrong steps in a history | drifts named, % |"
    )
    yield "|---|---:|---:|---:|---:|"
    for plan, score in scores.items():
        cells = (
            plan.name,
            f"{100 * score.power:.1f}" if score.planted else "",
            f"{100 * score.false_discoveries:.1f}" if score.planted else "",
            f"{score.wrong / score.histories:.3f}",
            f"{100 * score.named / score.drifts:.1f}" if score.drifts else "",
        )
        yield f"| {' | '.join(cells)} |"
    yield ""
    yield (
        "*Outliers*: 2 % of the releases are off by a normally distributed error of 1 %, of which"
        " nothing is known. *Understated*: the noise is twice as large as the standard errors say."
    )


if __name__ == "__main__":
    sys.exit(main())
