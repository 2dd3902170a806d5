"""The command `mjbench bisect`: which commit, or which release of MuJoCo, made it slower?"""

from typing import TYPE_CHECKING

import click

from mjbench.cli.ab import REVISION, revision_comparison
from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.cli.versions import model_of
from mjbench.commands.versions.options import BisectOptions

if TYPE_CHECKING:
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.session import Measurement


@cli.command()
@click.argument("baseline", metavar="OLD")
@click.argument("candidate", metavar="NEW")
@click.argument("target", metavar="FUNCTION|MODEL")
@takes(BisectOptions)
def bisect(baseline: str, candidate: str, target: str, options: BisectOptions) -> None:
    """Which commit or release after OLD, up to NEW, made it slower or faster?

    The ends are compared first, then the version in the middle with OLD, and so on by halving. The
    one that is found is compared with the one before it. A verdict that is inconclusive gets twice
    the time.

    With a FUNCTION (see `mjbench help ab`), versions are commits. All run the newer side's file. Of
    merges, first parents are followed.

    With a MODEL, they are the final releases of MuJoCo from OLD to NEW. Releases that are installed
    are preferred, others are installed in the cache, as by `mjbench versions`. What cannot be
    installed is skipped.

    \b
    Examples:
      mjbench bisect 3.2.7 3.4.0 robot.xml
      mjbench bisect 3.2.7 3.4.0 robot.xml --metric load --fail-on slower
      mjbench bisect v1.0 HEAD bench.py::step
    """
    from mjbench.commands.versions.bisect import revision_bisection
    from mjbench.commands.versions.function_sides import is_function

    plan, sides = options.plan, (baseline, candidate)
    if is_function(target) or any(side.startswith(REVISION) for side in sides):
        measurement = revision_bisection(revision_comparison(*sides, [target], options), plan)
    else:
        options.check_no_own_files()
        measurement = _of_releases(baseline, candidate, target, plan)
    run = measure_and_print(measurement, options, at_end=True)
    run.exit_with(options.exit_code_of_run(run.session.run(), plan.confidence))


def _of_releases(baseline: str, candidate: str, model: str, plan: "VerdictPlan") -> "Measurement":
    from mjbench.commands.versions.bisect import release_bisection
    from mjbench.releases import installs

    source = model_of(model)
    old, new = installs.parse_available([baseline, candidate])
    return release_bisection(old, new, source, plan)
