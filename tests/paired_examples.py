"""Targets and a short plan that the tests of paired comparison share."""

from mjbench.measuring.ratio import Ratio
from mjbench.paired import verdict
from mjbench.paired.judgement import Judgement
from mjbench.paired.outcomes import Verdict
from mjbench.paired.targets import Target
from mjbench.paired.verdict import PairedResult
from mjbench.releases import installs
from mjbench.simulation import models
from mjbench.status import Status

INSTALLED = installs.parse_release(installs.INSTALLED)
CARTPOLE = Target(INSTALLED, models.resolve("cartpole"))
CUBES = Target(INSTALLED, models.resolve("cube_table"))
# One launch: verdicts cost time, and how often they are right is not what is tested.
BRIEF = verdict.VerdictPlan(time_limit_s=0.1, as_shipped=True)


def decided(baseline: Target, candidate: Target, status: Status = Status.OK) -> PairedResult:
    """Return an invented verdict on two targets."""
    judgement = Judgement(Verdict.SAME, Ratio(1.0, 0.999, 1.001), 8, True)
    return PairedResult(baseline=baseline, candidate=candidate, status=status, judgement=judgement)
