"""Committed trials of verdicts, and how they ended."""

import functools
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from commands import ROOT

from benchmarks.verdicts.records import RECORD_TYPES, TrialRecord
from mjbench.paired.outcomes import Verdict
from mjbench.results import runs

RUNS = ROOT / "results/runs"
TRIALS = ROOT / "results/verdicts"
KNOWN = sorted(TRIALS.glob("reference-selfcheck-*.jsonl"))
INSIDE_STEP = sorted(TRIALS.glob("reference-inside-step*.jsonl"))
BETWEEN_BUILDS = sorted(TRIALS.glob("reference-between-builds*.jsonl"))


@functools.cache
def _trials_of(file: Path) -> list[TrialRecord]:
    return runs.load(file, RECORD_TYPES).of_type(TrialRecord)


def trials_of(files: Sequence[Path]) -> list[TrialRecord]:
    """Return the trials of several run files."""
    return [trial for file in files for trial in _trials_of(file)]


@dataclass(frozen=True)
class Share:
    """Some of all."""

    some: int
    all: int

    def __str__(self) -> str:
        return f"{self.some} of {self.all}"

    def __add__(self, other: "Share") -> "Share":
        return Share(self.some + other.some, self.all + other.all)


@dataclass(frozen=True)
class TrialCounts:
    """How many trials ended wrongly.

    Attributes:
      alarms_alike: a build called slower or faster than itself; alarms_between: than another build
        of the same work.
      undecided: of those between builds.
      missed_injected: slowdowns of 1 % or more after a block; missed_inside: of 0.9 % or more in
        the mean, inside a step.
    """

    alarms_alike: Share
    alarms_between: Share
    undecided: int
    missed_injected: Share
    missed_inside: Share

    @property
    def alarms(self) -> Share:
        """All that were called different."""
        return self.alarms_alike + self.alarms_between

    @property
    def missed(self) -> Share:
        """All that were missed."""
        return self.missed_injected + self.missed_inside

    def phrases(self) -> Iterator[str]:
        """Yield what README and the method's pages have of them."""
        yield f"{self.alarms} comparisons without a slowdown"
        yield f"{self.alarms_alike} of a build with itself"
        yield f"{self.alarms_between} between builds"
        yield f"{self.undecided} of the {self.alarms_between.all} stayed undecided"
        yield f"{self.missed} slowdowns of about 1 % or more"


@functools.cache
def trial_counts() -> TrialCounts:
    """Return the counts of all committed trials."""
    known, between = trials_of(KNOWN), trials_of(BETWEEN_BUILDS)
    cases = [
        list(of_case)
        for file in INSIDE_STEP
        for _, of_case in itertools.groupby(sorted(trials_of([file]), key=_case), key=_case)
    ]
    slowed = [case for case in cases if np.mean([trial.estimate for trial in case]) >= 1.009]
    inside = [*itertools.chain(*slowed)]
    return TrialCounts(
        alarms_alike=_alarms([trial for trial in known if trial.slowdown == 0]),
        alarms_between=_alarms(between),
        undecided=sum(trial.verdict == Verdict.INCONCLUSIVE for trial in between),
        missed_injected=_missed([t for t in known if t.slowdown and t.slowdown >= 0.01]),
        missed_inside=_missed(inside),
    )


def _case(trial: TrialRecord) -> tuple[str, str]:
    return trial.model, trial.callback


def _alarms(trials: Sequence[TrialRecord]) -> Share:
    different = {Verdict.SLOWER, Verdict.FASTER}
    return Share(sum(trial.verdict in different for trial in trials), len(trials))


def _missed(trials: Sequence[TrialRecord]) -> Share:
    return Share(sum(trial.verdict != Verdict.SLOWER for trial in trials), len(trials))
