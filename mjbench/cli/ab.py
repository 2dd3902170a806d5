"""The command `mjbench ab`: any two targets, or two revisions of your code, against each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.commands.versions.options import RevisionOptions
from mjbench.errors import InputError, shown

if TYPE_CHECKING:
    from mjbench.commands.versions.function_sides import RevisionComparison
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.session import Measurement

# What a side may begin with that is a revision of the user's code.
REVISION = "rev="


@cli.command()
@click.argument("baseline", metavar="BASELINE")
@click.argument("candidate", metavar="CANDIDATE")
@click.argument("functions", metavar="[FUNCTION]…", nargs=-1)
@takes(RevisionOptions)
def ab(baseline: str, candidate: str, functions: tuple[str, ...], options: RevisionOptions) -> None:
    """Is CANDIDATE faster or slower than BASELINE?

    Each is a model, such as robot.xml, KEY=VALUE,KEY=VALUE, or both, with a comma between. Keys:
    model, path, release, an option of the path (threads, chunk, pool, data, …), a field of
    MjOption (solver, integrator, iterations, tolerance, …), timer=off (without the timer of
    MuJoCo's Python package). A model, path or release that one of the two leaves out is the
    other's; where both leave it out, path is python_loop, and release is installed.

    FUNCTION is FILE.py::NAME, of your code. It is called without arguments, after `setup()` of its
    module, if there is one. Each side is then a revision of the git repository here: a branch, a
    tag, a commit, or WORKTREE, which includes what is not committed. `rev=main` is the same as
    `main`. Both sides run the newer side's file, so that a new benchmark can time old code.

    \b
    Examples:
      mjbench ab a.xml b.xml
      mjbench ab a.xml b.xml --metric load
      mjbench ab humanoid,solver=newton solver=cg
      mjbench ab humanoid,path=rollout,threads=2 path=batch_rollout,threads=2
      mjbench ab main HEAD bench.py::step
      mjbench ab main HEAD bench.py::step --metric memory
      mjbench ab HEAD WORKTREE my_package/physics.py::step --own-files --fail-on slower
    """
    from mjbench.commands.versions import show

    plan = options.plan
    if functions or any(
        side.startswith(REVISION) or "::" in side for side in (baseline, candidate)
    ):
        from mjbench.commands.versions.driver import between_revisions

        comparison = revision_comparison(baseline, candidate, functions, options)
        measurement = between_revisions(comparison, plan)
    else:
        options.check_no_own_files()
        measurement = _of_targets(baseline, candidate, plan)
    run = measure_and_print(measurement, options, summary=show.sections)
    run.exit_with(options.exit_code_of_run(run.session.run(), plan.confidence))


def _of_targets(baseline: str, candidate: str, plan: "VerdictPlan") -> "Measurement":
    from mjbench.commands.versions.driver import between_targets
    from mjbench.paired import targets
    from mjbench.releases import installs

    pair = targets.parse(baseline, candidate)
    targets.check_targets(plan.sizes.metric, pair)
    installs.check_available(target.release for target in pair)
    has_one_build = len({target.release.key for target in pair}) == 1  # its code stays where it is
    plan = replace(plan, as_shipped=plan.as_shipped or has_one_build)
    return between_targets("ab", [pair], plan)


def revision_comparison(
    baseline: str, candidate: str, functions: Sequence[str], options: RevisionOptions
) -> "RevisionComparison":
    """Return the comparison of functions in two revisions, as a command line names them.

    Raises:
      InputError: there are none, or the options say what is of models alone.
    """
    from mjbench.commands.versions import function_sides
    from mjbench.commands.versions.driver import check_function_plan
    from mjbench.commands.versions.function_sides import RevisionComparison
    from mjbench.releases.revisions import Repository

    sides = [side.removeprefix(REVISION) for side in (baseline, candidate)]
    if any("=" in side or function_sides.is_function(side) for side in sides):
        raise InputError(
            "a revision is compared with a revision: give two, and functions after them, such as"
            " main HEAD bench.py::step"
        )
    others = [shown(name) for name in functions if not function_sides.is_function(name)]
    if others or not functions:
        instead = f", not {others[0]}" if others else ""
        raise InputError(f"name a function of your code, {function_sides.FORM}{instead}")
    cwd = Path.cwd().resolve()
    repository = Repository(cwd)
    parsed = function_sides.parse_functions(functions, cwd, repository.top)
    check_function_plan(options.plan)
    old, new = map(repository.parse, sides)
    return RevisionComparison(repository, old, new, parsed, cwd, options.own_files)
