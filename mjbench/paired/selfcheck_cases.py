"""The cases of a selfcheck: pairs of targets of which the truth is known."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench.paired.outcomes import Arm
from mjbench.paired.selfcheck_records import CaseRow, TrialRecord
from mjbench.paired.targets import Target
from mjbench.releases import installs
from mjbench.releases.release import NoChangePair
from mjbench.simulation.models import ModelSource


@dataclass(frozen=True)
class Case:
    """Two targets, and how they differ."""

    arm: Arm
    baseline: Target
    candidate: Target

    def row(self) -> CaseRow:
        """Return what records say of it."""
        return CaseRow(
            arm=self.arm,
            model=self.candidate.model.name,
            slowdown=None if self.arm == Arm.INSIDE_STEP else self.candidate.slowdown,
            callback=self.candidate.callback,
            old=self.baseline.release.version,
            new=self.candidate.release.version,
        )


def slowed(model: ModelSource, slowdown: float) -> Case:
    """Return a case in which each block of the candidate lasts longer by a share, such as 0.01.

    Its process spins for that share of the time that the block took. So every slowdown is exact, of
    every model, and blocks do as much work as those of an ordinary comparison. Where the slowdown
    is 0, the targets are identical.
    """
    baseline = _installed(model)
    return Case(Arm.SLOWDOWN, baseline, replace(baseline, slowdown=slowdown))


def inside_step(model: ModelSource, function: str) -> Case:
    """Return a case in which every step of the candidate calls a function of the engine."""
    baseline = _installed(model)
    return Case(Arm.INSIDE_STEP, baseline, replace(baseline, callback=function))


def between_builds(model: ModelSource, pair: NoChangePair) -> Case:
    """Return a case of two releases whose steps execute equally many instructions."""
    baseline, candidate = (
        Target(installs.parse_release(release), model) for release in (pair.old, pair.new)
    )
    return Case(Arm.BETWEEN_BUILDS, baseline, candidate)


def remaining(cases: Sequence[Case], trials: int, records: Sequence[TrialRecord]) -> Iterator[Case]:
    """Yield a case for each trial to do, in turns, so that a change of the machine hits all.

    Args:
      trials: of each case.
      records: of trials that were done before.
    """
    done = Counter(record.case() for record in records)
    for turn in range(trials):
        for case in cases:
            if done[case.row()] <= turn:
                yield case


def _installed(model: ModelSource) -> Target:
    return Target(installs.parse_release(installs.INSTALLED), model)
