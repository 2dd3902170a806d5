"""The command `mjbench bisect`: which commit made a function of your code slower?"""

from typing import TYPE_CHECKING

import click

from mjbench.cli.ab import revision_comparison
from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import OUTPUT, VERDICT_PLAN, with_options

if TYPE_CHECKING:
    from mjbench.paired.verdict import VerdictPlan


@cli.command()
@click.argument("baseline", metavar="rev=OLD")
@click.argument("candidate", metavar="rev=NEW")
@click.argument("function", metavar="FUNCTION")
@with_options(VERDICT_PLAN, OUTPUT)
def bisect(
    baseline: str, candidate: str, function: str, plan: "VerdictPlan", output: OutputOptions
) -> None:
    """Which commit after OLD, up to NEW, made a function of your code slower or faster?

    The ends are compared first. Commits between them are measured where that tells most; then the
    commit that is probably the first to differ is compared with the one before it. A FUNCTION is
    named as for `mjbench ab rev=…`, and rev= may be left out; a file is
    NEW's in all commits. Of merges, first parents are followed.

    \b
    Examples:
      mjbench bisect rev=v1.0 rev=HEAD bench.py::step
    """
    from mjbench.api.revisions import bisection
    from mjbench.report.kinds import BISECT

    comparison = revision_comparison(baseline, candidate, [function], plan)
    measure_and_print(bisection(comparison, plan), output, summary=BISECT.sections).exit()
