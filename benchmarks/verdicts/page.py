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
    """Yield the table: a row for each kind of trial."""
    groups: dict[str, list[TrialRecord]] = {}
    for trial in trials:
        groups.setdefault(_case(trial), []).append(trial)
    rows = [_row(case, groups[case]) for case in sorted(groups)]
    yield from markdown.table_lines(["tried", *_COLUMNS], rows, _COLUMNS)


def _case(trial: TrialRecord) -> str:
    if trial.arm == Arm.BETWEEN_BUILDS:
        return "releases in which nothing changed"
    if trial.callback:
        return f"each step calls `{trial.callback}`"
    return f"slower by {100 * trial.slowdown:g} %" if trial.slowdown else "a build with itself"


def _row(tried: str, trials: Sequence[TrialRecord]) -> list[str]:
    adds = f", which adds {_estimates(trials)}" if trials[0].callback else ""
    counts = [sum(t.verdict == verdict for t in trials) for verdict in _VERDICTS]
    seconds = statistics.median(t.seconds for t in trials)
    return [f"{tried}{adds}", str(len(trials)), *map(str, counts), f"{seconds:.1f}"]


def _estimates(trials: Sequence[TrialRecord]) -> str:
    """Return the mean estimates of the models, such as `1.0 to 1.6 %`."""
    of_models = [[t.estimate for t in trials if t.model == m] for m in {t.model for t in trials}]
    means = [100 * (statistics.fmean(estimates) - 1) for estimates in of_models]
    return f"{min(means):.1f} to {max(means):.1f} %"


if __name__ == "__main__":
    PART.write(lines(committed_trials()))
