"""The command `mjbench ab`: any two targets, or two revisions of your code, against each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.commands.versions.options import TargetOptions
from mjbench.errors import InputError, shown

if TYPE_CHECKING:
    from mjbench.commands.versions.function_sides import RevisionComparison
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.session import Measurement

# What a side begins with that is a revision of the user's code.
REVISION = "rev="


@cli.command()
@click.argument("baseline", metavar="BASELINE")
@click.argument("candidate", metavar="CANDIDATE")
@click.argument("functions", metavar="[FUNCTION]…", nargs=-1)
@takes(TargetOptions)
def ab(baseline: str, candidate: str, functions: tuple[str, ...], options: TargetOptions) -> None:
    """Is CANDIDATE faster or slower than BASELINE, each given as KEY=VALUE,KEY=VALUE?

    Keys: model, path, release, an option of the path (threads, chunk, pool, data, …), a field of
    MjOption (solver, integrator, iterations, tolerance, …), timer=off (without the timer of
    MuJoCo's Python package). A model, path or release that one of
    the two leaves out is the other's; where both leave it out, it is cartpole, python_loop or
    installed.

    Or each is rev=REVISION, a branch, tag or commit of the git repository here, or rev=WORKTREE,
    what is not committed included. Then name functions of your code, and rev= may be left out. Each
    is called without arguments, after `setup()` of its module, if there is one. With
    bench.py::step, both sides run the CANDIDATE's bench.py, so that a new benchmark can time old
    code. If bench.py itself changed, write bench:step: each side then runs its own.

    \b
    Examples:
      mjbench ab path=rollout,threads=2 path=batch_rollout,threads=2
      mjbench ab model=a.xml model=b.xml
      mjbench ab model=humanoid,solver=newton solver=cg
      mjbench ab model=a.xml model=b.xml --metric load
      mjbench ab rev=main rev=HEAD bench.py::step
      mjbench ab rev=main rev=HEAD bench:step --metric memory
      mjbench ab HEAD WORKTREE my_package.physics:step --fail-on slower
    """
    from mjbench.commands.versions import show

    plan = options.plan
    if any(side.startswith(REVISION) for side in _as_revisions((baseline, candidate), functions)):
        from mjbench.commands.versions.driver import between_revisions

        comparison = revision_comparison(baseline, candidate, functions, plan)
        measurement = between_revisions(comparison, plan)
    elif functions:
        name = shown(functions[0])
        if _are_functions(functions):
            raise InputError(f"{name}: functions are compared in revisions, rev=…")
        text = "name a model beside the rest, as in path=rollout,model=cartpole"
        raise InputError(f"{name} is no function: {text}")
    else:
        measurement = _of_targets(baseline, candidate, plan)
    run = measure_and_print(measurement, options, summary=show.sections)
    run.exit_with(options.exit_code_of_run(run.session.run(), plan.confidence))


def _are_functions(names: Sequence[str]) -> bool:
    return any(":" in name for name in names)


def _as_revisions(sides: Sequence[str], functions: Sequence[str]) -> list[str]:
    """Return sides with `rev=` where it was left out, as it may be before a function."""
    if not _are_functions(functions):
        return list(sides)
    return [f"{REVISION}{side}" if side and "=" not in side else side for side in sides]


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
    baseline: str, candidate: str, functions: Sequence[str], plan: "VerdictPlan"
) -> "RevisionComparison":
    """Return the comparison of functions in two revisions, as a command line names them.

    Raises:
      InputError: there are none, or the plan says what is of models alone.
    """
    from mjbench.commands.versions import function_sides
    from mjbench.commands.versions.driver import check_function_plan
    from mjbench.commands.versions.function_sides import RevisionComparison
    from mjbench.releases.revisions import Repository

    sides = _as_revisions((baseline, candidate), functions)
    if not all(side.startswith(REVISION) for side in sides):
        raise InputError("a revision is compared with a revision: give rev=… twice")
    if not functions:
        raise InputError(f"name a function of your code: {function_sides.FORMS}")
    check_function_plan(plan)
    cwd = Path.cwd().resolve()
    repository = Repository(cwd)
    old, new = (repository.parse(side.removeprefix(REVISION)) for side in sides)
    parsed = [
        function_sides.parse_function(name, cwd, repository.top)
        for name in dict.fromkeys(functions)
    ]
    return RevisionComparison(repository, old, new, parsed, cwd)
