"""The command `mjbench versions`: releases of MuJoCo against each other."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.fail_on import FAIL_ON, FailOn
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    NAMES,
    STORING,
    VERDICT_PLAN,
    metric_option,
    mode,
    with_options,
)
from mjbench.errors import InputError, shown, suggestion
from mjbench.paired.metrics import Metric
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.releases.release_names import ReleaseSpec


@cli.command()
@mode("--explain", "Which functions account for the difference? Needs valgrind.")
@click.argument("names", nargs=-1, metavar="[OLD NEW…] [MODEL]…")
@click.option("--old", metavar="RELEASE", help="The old release, if it is not the first argument.")
@click.option(
    "--new",
    "news",
    multiple=True,
    metavar="RELEASE",
    help="A new release; may be given several times.",
)
@click.option(
    "--paths",
    "path_names",
    type=NAMES,
    help="Ways of stepping, each compared between the releases  [default: python_loop]",
)
@metric_option(*Metric)
@click.option(
    "--function",
    "functions",
    multiple=True,
    metavar="FUNCTION",
    help="A function of your code to time in place of a MODEL, such as bench.py::step; may be given"
    " several times. It is called as by `mjbench ab rev=…`; your code is the same on both sides.",
)
@click.option(
    "--family",
    type=COUNT,
    help="Correct for N comparisons in all, where other commands make some of them: a change then"
    " needs more evidence  [default: those of this command]",
)
@with_options(FAIL_ON, VERDICT_PLAN, STORING)
def versions(
    names: tuple[str, ...],
    old: str | None,
    news: tuple[str, ...],
    path_names: list[str] | None,
    metric: str,
    functions: tuple[str, ...],
    family: int | None,
    fail_on: FailOn,
    plan: "VerdictPlan",
    output: OutputOptions,
) -> None:
    """Is MODEL slower with a NEW release of MuJoCo than with the OLD one?

    A release is a version (3.5.0), a wheel or a folder of wheels, `installed`, `newest` (the last
    on the package index) or `previous` (the one before it). Each is installed in its own folder in
    the cache (`mjbench releases installs` lists them). There may be several NEW ones. Without a
    MODEL: all shipped models.

    Other packages are named as pip takes them, with commas: jax==0.7.0,jaxlib==0.7.0. They are
    installed beside this environment's MuJoCo and NumPy, unless those are among them.

    \b
    Examples:
      mjbench versions 3.3.0 4.0.0 humanoid
      mjbench versions previous newest robot.xml
      mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower,changed-work
      mjbench versions 3.17.0 4.0.0 robot.xml --metric instructions --min-effect 0.5%
      mjbench versions --old installed --new dist/mujoco-4.1.0-cp311-….whl cartpole
      mjbench versions jax==0.7.0,jaxlib==0.7.0 jax==0.7.1,jaxlib==0.7.1 cartpole --paths mjx
      mjbench versions numpy==2.3.5 numpy==2.4.0 --function bench.py::step

    Ratios are new over old: above 1 is slower. Where a release does other work, such as more
    contacts, the verdict names it.
    """
    from mjbench.api.verdict_measurements import between_releases
    from mjbench.commands.versions import show as verdicts

    releases, sources = (
        (list(names), list[ModelSource]()) if functions else releases_and_models(names)
    )
    specs = _releases(old, news, releases)
    sizes = replace(plan.sizes, metric=Metric(metric))
    plan = replace(plan, family=family or 1, sizes=sizes)
    measurement = between_releases(specs, sources, path_names, plan, functions)
    run = measure_and_print(measurement, output, summary=verdicts.sections)
    run.exit_with(fail_on.of_run(run.session.run(), plan.confidence))


def _releases(old: str | None, news: Sequence[str], releases: Sequence[str]) -> list["ReleaseSpec"]:
    from mjbench.releases import installs

    names = [old, *releases] if old else list(releases)
    if not names or len(names) + len(news) < 2:
        raise InputError("name an OLD and a NEW release, such as `mjbench versions 3.3.0 4.0.0`")
    return installs.parse_available([names[0], *news, *names[1:]])


def releases_and_models(names: Sequence[str]) -> tuple[list[str], list[ModelSource]]:
    """Return the releases among names, and the models of the others; without any, all shipped."""
    from mjbench.releases import release_names

    releases = [name for name in names if release_names.is_release(name)]
    model_names = [name for name in names if name not in releases]
    return releases, [_model(name) for name in model_names or models.shipped()]


def _model(name: str) -> ModelSource:
    from mjbench.releases import release_names, wheels

    try:
        return models.resolve(name)
    except models.UnknownModelError:
        known = [
            release_names.INSTALLED,
            release_names.NEWEST,
            release_names.PREVIOUS,
            *models.shipped(),
        ]
        raise InputError(
            f"{shown(name)} is neither a release nor a model{suggestion(name, known)}:"
            f" a release is {release_names.FORMS}; a model is one of {', '.join(models.shipped())},"
            f" {models.FORMS}"
        ) from None
    except InputError:
        if not wheels.is_folder(name):
            raise
        raise InputError(
            f"{shown(name)} is a folder without wheels; name wheels of mujoco, or a model's file"
        ) from None
