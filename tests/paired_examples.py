"""Targets and a short plan that the tests of paired comparison share."""

from mjbench.paired import verdict
from mjbench.paired.targets import Target
from mjbench.releases import installs
from mjbench.simulation import models

INSTALLED = installs.parse_release(installs.INSTALLED)
CARTPOLE = Target(INSTALLED, models.resolve("cartpole"))
CUBES = Target(INSTALLED, models.resolve("cube_table"))
# One launch: verdicts cost time, and how often they are right is not what is tested.
BRIEF = verdict.VerdictPlan(time_limit_s=0.1, as_shipped=True)
