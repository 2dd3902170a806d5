"""The command `mjbench ab`: any two targets against each other."""

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions
from mjbench.cli.fail_on import FAIL_ON, FailOn, measure_verdicts
from mjbench.cli.group import cli
from mjbench.cli.shared import STORING, VERDICT_PLAN, with_options

if TYPE_CHECKING:
    from mjbench.paired.verdict import VerdictPlan


@cli.command()
@click.argument("baseline", metavar="BASELINE")
@click.argument("candidate", metavar="CANDIDATE")
@with_options(FAIL_ON, VERDICT_PLAN, STORING)
def ab(
    baseline: str,
    candidate: str,
    fail_on: FailOn,
    plan: "VerdictPlan",
    output: OutputOptions,
) -> None:
    """Is CANDIDATE faster or slower than BASELINE, each given as KEY=VALUE,KEY=VALUE?

    Keys: model, path, release, an option of the path (threads, chunk, pool, data, …), a field of
    MjOption (solver, integrator, iterations, tolerance, …), timer=off (without the timer of
    MuJoCo's Python package). A model, path or release that one of
    the two leaves out is the other's; where both leave it out, it is cartpole, python_loop or
    installed.

    \b
    Examples:
      mjbench ab path=rollout,threads=2 path=batch_rollout,threads=2
      mjbench ab model=a.xml model=b.xml
      mjbench ab model=humanoid,solver=newton solver=cg
    """
    from mjbench.api.versions import verdicts
    from mjbench.paired import targets

    pair = targets.parse(baseline, candidate)
    has_one_build = len({target.release.key for target in pair}) == 1  # its code stays where it is
    plan = replace(plan, as_shipped=plan.as_shipped or has_one_build)
    measure_verdicts(verdicts("ab", [pair], plan), plan.confidence, fail_on, output)
