"""The command `mjbench bisect`: which commit, or which release of MuJoCo, made it slower?"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from mjbench.cli.ab import REVISION, revision_comparison
from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.commands.versions.options import BisectOptions
from mjbench.simulation import models

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

    With rev=OLD rev=NEW, these are commits, and FUNCTION is one of your code, named as for
    `mjbench ab rev=…`; before a FILE.py::FUNCTION, rev= may be left out. All commits run
    NEW's copy of that file. Of merges, first parents are followed.

    Otherwise, they are the final releases of MuJoCo from OLD to NEW, and the steps of MODEL are
    timed. Releases that are installed are preferred, others are installed in the cache, as by
    `mjbench versions`. What cannot be installed is skipped.

    \b
    Examples:
      mjbench bisect 3.2.7 3.4.0 robot.xml
      mjbench bisect rev=v1.0 rev=HEAD bench.py::step
    """
    of = _of_revisions if _are_revisions((baseline, candidate), target) else _of_releases
    measurement = of(baseline, candidate, target, options.plan)
    measure_and_print(measurement, options, at_end=True).exit()


def _are_revisions(sides: Sequence[str], target: str) -> bool:
    """Return whether two sides are meant as revisions: models of packages have a colon, too."""
    from mjbench.releases.release_names import is_release

    if "::" in target or any(side.startswith(REVISION) for side in sides):
        return True
    return ":" in target and not all(map(is_release, sides))


def _of_releases(baseline: str, candidate: str, model: str, plan: "VerdictPlan") -> "Measurement":
    from mjbench.commands.versions.bisect_driver import release_bisection
    from mjbench.releases import installs

    source = models.resolve(model)
    old, new = installs.parse_available([baseline, candidate])
    return release_bisection(old, new, source, plan)


def _of_revisions(
    baseline: str, candidate: str, function: str, plan: "VerdictPlan"
) -> "Measurement":
    from mjbench.commands.versions.bisect_driver import revision_bisection

    comparison = revision_comparison(baseline, candidate, [function], plan)
    return revision_bisection(comparison, plan)
