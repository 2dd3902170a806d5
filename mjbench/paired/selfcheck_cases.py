"""The cases of a selfcheck: pairs of targets of which the truth is known."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from mjbench.errors import InputError
from mjbench.paired.block_sizes import Sizes
from mjbench.paired.outcomes import Arm
from mjbench.paired.selfcheck_records import CaseRow, TrialRecord
from mjbench.paired.targets import Target
from mjbench.releases import installs
from mjbench.releases.no_change_pairs import NoChangePair
from mjbench.simulation.models import ModelSource

# Simulations of a block, at most: a slowdown is a whole number of them.
MAX_NBATCH = 200


@dataclass(frozen=True)
class Case:
    """Two targets, and how they differ.

    Attributes:
      arm: kind of difference.
      baseline: the one target.
      candidate: the other.
      sizes: of a block.
    """

    arm: Arm
    baseline: Target
    candidate: Target
    sizes: Sizes = field(default_factory=Sizes)

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
    """Return a case in which the candidate does a share of the work once more, such as 0.01.

    A block holds the fewest simulations of which the slowdown is a whole number; the usual ones
    for a slowdown of 0, where the targets are identical.

    Raises:
      InputError: it is not a whole number of at most MAX_NBATCH simulations.
    """
    baseline = _installed(model)
    if slowdown == 0:
        return Case(Arm.SLOWDOWN, baseline, baseline)
    share = Fraction(slowdown).limit_denominator(MAX_NBATCH)
    if share <= 0 or abs(share - slowdown) > 1e-9:
        raise InputError(
            f"cannot inject a slowdown of {100 * slowdown:g} %: it must be a whole number of at"
            f" most {MAX_NBATCH} simulations, such as 0.5 % (1 of 200) or 1 % (1 of 100)"
        )
    candidate = replace(baseline, slowdown=slowdown)
    return Case(Arm.SLOWDOWN, baseline, candidate, Sizes(nbatch=share.denominator))


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
      cases: to try.
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
