"""The command `mjbench versions`: releases of MuJoCo against each other."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import mode, takes
from mjbench.commands.versions.options import VersionsOptions
from mjbench.errors import InputError, shown, suggestion
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.releases.release_names import ReleaseSpec


@cli.command()
@mode("--explain", "Which functions account for the difference? Needs valgrind.")
@click.argument("names", nargs=-1, metavar="[OLD NEW…] [MODEL]…")
@takes(VersionsOptions)
def versions(names: tuple[str, ...], options: VersionsOptions) -> None:
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
    from mjbench.commands.versions import show
    from mjbench.commands.versions.driver import between_releases

    releases, sources = (
        (list(names), list[ModelSource]()) if options.functions else releases_and_models(names)
    )
    specs = _releases(options.old, options.news, releases)
    plan = options.plan
    measurement = between_releases(specs, sources, options.paths, plan, options.functions)
    run = measure_and_print(measurement, options, summary=show.sections)
    run.exit_with(options.exit_code_of_run(run.session.run(), plan.confidence))


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
