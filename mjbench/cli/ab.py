"""The command `mjbench ab`: any two targets against each other."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from mjbench.cli import paired_options
from mjbench.cli.context import OutputOptions
from mjbench.cli.fail_on import FAIL_ON, FailOn, Finding
from mjbench.cli.group import cli
from mjbench.cli.shared import JUDGING, SIZES, STORING, with_options


@cli.command()
@click.argument("baseline", metavar="BASELINE")
@click.argument("candidate", metavar="CANDIDATE")
@with_options(*FAIL_ON, *JUDGING, *SIZES, *STORING)
def ab(
    baseline: str,
    candidate: str,
    findings: list[Finding],
    allow_inconclusive: bool,
    results: Path,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
    **chosen: Any,
) -> None:
    """Is CANDIDATE faster or slower than BASELINE, each given as KEY=VALUE,KEY=VALUE?

    Keys: model, path, release, an option of the path (threads, chunk, pool, data, …), a field of
    MjOption (solver, integrator, iterations, tolerance, …). A model, path or release that one of
    the two leaves out is the other's; where both leave it out, it is cartpole, python_loop or
    installed.

    \b
    Examples:
      mjbench ab path=rollout,threads=2 path=batch_rollout,threads=2
      mjbench ab model=a.xml model=b.xml
      mjbench ab model=humanoid,solver=newton solver=cg
    """
    from mjbench.paired import targets

    pairs = [targets.parse(baseline, candidate)]
    plan = paired_options.verdict_plan(**chosen)
    if len({target.release.key for target in pairs[0]}) == 1:
        plan = replace(plan, as_shipped=True)  # both have their code at the same place
    fail_on = FailOn(findings, allow_inconclusive)
    output = OutputOptions(results, resume, wait, json_file)
    sys.exit(paired_options.compare_targets("ab", pairs, plan, fail_on, output))
