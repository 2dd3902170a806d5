"""The table of docs/method/errors.md: verdicts of the committed selfchecks, by what was tried.

`python -m benchmarks.studies.selfcheck_page` writes it again from results/runs.
"""

import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.studies.page_part import PagePart
from mjbench.pages import markdown
from mjbench.paired.outcomes import Arm, Verdict
from mjbench.paired.selfcheck_records import TrialRecord

RUNS = Path(__file__).resolve().parents[2] / "results" / "runs"
PART = PagePart("method/errors.md", "selfchecks", "benchmarks.studies.selfcheck_page")
_COLUMNS = ("comparisons", "slower", "faster", "same", "inconclusive", "median s")
_VERDICTS = (Verdict.SLOWER, Verdict.FASTER, Verdict.SAME, Verdict.INCONCLUSIVE)


def committed_trials() -> list[TrialRecord]:
    """Return the trials of all committed selfchecks."""
    # late: asv imports this module where few packages are
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import runs

    files = sorted(RUNS.glob("reference-*.jsonl"))
    return [t for file in files for t in runs.load(file, RECORD_TYPES).of_type(TrialRecord)]


def lines(trials: Sequence[TrialRecord]) -> Iterator[str]:
    """Yield the table: a row for each kind of trial and size."""
    groups: dict[tuple[str, str], list[TrialRecord]] = {}
    for trial in trials:
        groups.setdefault(_case(trial), []).append(trial)
    rows = [_row(*case, groups[case]) for case in sorted(groups)]
    yield from markdown.table_lines(["tried", "on", *_COLUMNS], rows, _COLUMNS)


def _case(trial: TrialRecord) -> tuple[str, str]:
    if trial.arm == Arm.BETWEEN_BUILDS:
        return "releases in which nothing changed", "ten models"
    if trial.callback:
        return f"each step calls `{trial.callback}`", trial.model
    if trial.slowdown:
        return f"slower by {100 * trial.slowdown:g} %", trial.model
    return "a build with itself", trial.model


def _row(tried: str, model: str, trials: Sequence[TrialRecord]) -> list[str]:
    estimate = statistics.fmean(t.estimate for t in trials) - 1
    adds = f", which adds {100 * estimate:.1f} %" if trials[0].callback else ""
    counts = [sum(t.verdict == verdict for t in trials) for verdict in _VERDICTS]
    seconds = statistics.median(t.seconds for t in trials)
    return [f"{tried}{adds}", model, str(len(trials)), *map(str, counts), f"{seconds:.1f}"]


if __name__ == "__main__":
    PART.write(lines(committed_trials()))
