"""The table of docs/method/errors.md: verdicts of the committed trials, by what was tried.

`python -m benchmarks.verdicts.page` writes it again from results/verdicts.
"""

import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.studies.page_part import PagePart
from benchmarks.verdicts.records import RECORD_TYPES, Arm, TrialRecord
from mjbench.paired.outcomes import Verdict
from mjbench.results import markdown, runs

TRIALS = Path(__file__).resolve().parents[2] / "results/verdicts"
PART = PagePart("method/errors.md", "trials", "benchmarks.verdicts.page")
_COLUMNS = ("comparisons", "slower", "faster", "same", "inconclusive", "median s")
_VERDICTS = (Verdict.SLOWER, Verdict.FASTER, Verdict.SAME, Verdict.INCONCLUSIVE)


def committed_trials() -> list[TrialRecord]:
    """Return the trials of all committed run files."""
    files = sorted(TRIALS.glob("reference-*.jsonl"))
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
