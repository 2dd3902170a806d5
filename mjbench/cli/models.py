"""`mjbench models`: models and their sizes."""

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, with_options


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@with_options(LIMIT, JSON)
def models(names: tuple[str, ...], time_limit: float, json_file: str | None) -> None:
    """List models: sizes, contacts and constraints at the start, timestep, integrator, solver.

    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench models
      mjbench models gymnasium:ant
    """
    from mjbench.comparison.listing import list_models
    from mjbench.report import listings
    from mjbench.report.documents import ModelRow, ModelsDocument
    from mjbench.simulation.models import resolve, shipped

    sources = [resolve(name) for name in names or shipped()]
    with RunContext(json_file, [source.path for source in sources]) as run:
        listed = list_models(sources, time_limit)
        run.table(listings.models_table(listed))
        for line in listings.failed_models(listed):
            run.out.print(line, soft_wrap=True)
        run.write(ModelsDocument(models=[ModelRow.of(model) for model in listed]))
    run.exit(model.status for model in listed)
