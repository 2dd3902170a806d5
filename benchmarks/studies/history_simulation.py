"""How many change points of simulated histories are detected, and how many listed ones are wrong.

    python -m benchmarks.studies.history_simulation [--histories 1000]

draws histories of a model whose truth is known, looks for changes as `benchmarks.history` does, and
writes a part of docs/method/history.md. It takes about a minute.
"""

import sys
from collections.abc import Iterator, Sequence

from benchmarks.studies import simulated_histories, tally_command
from benchmarks.studies.page_part import PagePart
from benchmarks.studies.simulated_histories import PLANS, RELEASES, Plan, Score
from mjbench import formats
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
    yield _conclusion(scores)
    yield ""
    yield _detected(scores)


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


def _detected(scores: dict[Plan, Score]) -> str:
    histories = next(iter(scores.values())).histories
    power = {plan.name: 100 * score.power for plan, score in scores.items() if score.planted}
    sizes = formats.listed(
        [f"{power[f'changes of {size} %']:.1f} % of those of {size} %" for size in (1, 1.5, 2)]
    )
    return (
        f"Each kind of noise has {histories:,} histories of {RELEASES} releases. If releases"
        " scatter as the [no-change pairs](errors.md#what-is-tried) do, a change is detected, at"
        f" the very release, in {sizes}. With a standard error of 0.5 %, it is"
        f" {power['changes of 2 %, deviation 0.5 %']:.1f} % of those of 2 %. Only changes of 1 % or"
        " more are listed."
    )


if __name__ == "__main__":
    sys.exit(main())
