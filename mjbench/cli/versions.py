"""The command `mjbench versions`: releases of MuJoCo against each other."""

from collections.abc import Sequence

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import mode, takes
from mjbench.commands.versions.options import ExplainOptions, VersionsOptions
from mjbench.errors import InputError, shown, suggestion
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import Status


@cli.command()
@mode("--explain", "Which functions account for the difference? Needs valgrind.")
@click.argument("names", nargs=-1, metavar="OLD NEW… MODEL…")
@takes(VersionsOptions)
def versions(names: tuple[str, ...], options: VersionsOptions) -> None:
    """Is MODEL slower with a NEW release of MuJoCo than with the OLD one?

    A release is a version (3.5.0), a wheel or a folder of wheels, `installed`, `newest` (the last
    on the package index) or `previous` (the one before it). Each is installed in its own folder in
    the cache (`mjbench releases installs` lists them). There may be several NEW ones.

    Other packages are named as pip takes them, with commas: jax==0.7.0,jaxlib==0.7.0. They are
    installed beside this environment's MuJoCo and NumPy, unless those are among them.

    In place of MODEL, name a function of your code, FILE.py::NAME (see `mjbench help ab`).

    \b
    Examples:
      mjbench versions 3.17.0 4.0.0 humanoid
      mjbench versions previous newest robot.xml
      mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower,changed-work
      mjbench versions 3.17.0 4.0.0 robot.xml --metric instructions --min-effect 0.5%
      mjbench versions installed dist/mujoco-4.1.0-cp311-….whl cartpole
      mjbench versions jax==0.7.0,jaxlib==0.7.0 jax==0.7.1,jaxlib==0.7.1 cartpole --paths mjx
      mjbench versions numpy==2.3.5 numpy==2.4.0 bench.py::step

    Ratios are new over old: above 1 is slower. Where a release does other work, such as more
    contacts, the verdict names it.
    """
    from mjbench.commands.versions import show
    from mjbench.commands.versions.driver import between_releases
    from mjbench.commands.versions.function_sides import is_function
    from mjbench.releases import installs

    functions = [name for name in names if is_function(name)]
    others = [name for name in names if name not in functions]
    releases, sources = releases_and_models(others, needs_model=not functions)
    if functions and sources:
        raise InputError("name models or functions, not both")
    specs, plan = installs.parse_available(releases), options.plan
    measurement = between_releases(specs, sources, options.paths, plan, functions)
    run = measure_and_print(measurement, options, summary=show.sections)
    run.exit_with(options.exit_code_of_run(run.session.run(), plan.confidence))


@cli.command("versions --explain")
@click.argument("names", nargs=-1, required=True, metavar="OLD NEW MODEL…")
@takes(ExplainOptions)
def versions_explain(names: tuple[str, ...], options: ExplainOptions) -> None:
    """Explain what changed from the OLD release to the NEW one: instructions, work, or time alone.

    Needs valgrind. Lists instructions per step by function and by stage, the largest difference
    first, with the work done and the ratio of wall-clock times. Times and counts are of the same
    simulations.

    \b
    Example:
      mjbench versions --explain 3.17.0 4.0.0 pile
    """
    from mjbench.commands.versions.explain_driver import of_change
    from mjbench.counts import show
    from mjbench.counts.records import ExplainRecord
    from mjbench.releases import installs

    releases, sources = releases_and_models(names)
    run = measure_and_print(
        of_change(installs.parse_available(releases), sources, options),
        options,
        each=lambda run: show.explanations(run.of_type(ExplainRecord), options.top),
    )
    rows = run.session.run().of_type(ExplainRecord)
    run.exit(
        row.time.status if row.time and row.status == Status.OK else row.status for row in rows
    )


def releases_and_models(
    names: Sequence[str], needs_model: bool = True
) -> tuple[list[str], list[ModelSource]]:
    """Return the releases among names, two or more, and the models of the others."""
    from mjbench.releases import release_names

    releases = [name for name in names if release_names.is_release(name)]
    sources = [model_of(name) for name in names if name not in releases]
    if len(releases) < 2:
        raise InputError("name an OLD and a NEW release, such as 3.17.0 4.0.0")
    if needs_model:
        models.check_any(sources)
    return releases, sources


def model_of(name: str) -> ModelSource:
    """Return the model that stands beside releases."""
    from mjbench.commands.versions.function_sides import FORM
    from mjbench.releases import release_names, wheels

    try:
        return models.resolve(name)
    except models.UnknownModelError:
        known = [*release_names.NAMES, *models.shipped()]
        raise InputError(
            f"{shown(name)} is neither a release nor a model{suggestion(name, known)}:"
            f" a release is {release_names.FORMS}; a model is one of {models.choices()}"
        ) from None
    except InputError as error:
        if wheels.is_folder(name):
            raise InputError(
                f"{shown(name)} is a folder without wheels; name wheels of mujoco, or a model's"
                " file"
            ) from None
        if ":" in name:
            raise InputError(f"{error}; a function is {FORM}") from None
        raise
