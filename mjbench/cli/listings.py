"""`mjbench models` and `mjbench paths`: what there is to measure."""

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, models_argument, with_options
from mjbench.simulation.models import ModelSource


@cli.command()
@models_argument()
@with_options(LIMIT, JSON)
def models(sources: list[ModelSource], limit_s: float, json_file: str | None) -> None:
    """List models: sizes, contacts and constraints at the start, timestep, integrator, solver.

    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench models
      mjbench models gymnasium:ant
    """
    from mjbench.commands.show import listings
    from mjbench.commands.show.model_facts import list_models
    from mjbench.results.json_form import ResultsDocument

    with RunContext(json_file, [source.path for source in sources]) as run:
        listed = list_models(sources, limit_s)
        run.table(listings.models_table(listed))
        for line in listings.failed_models(listed):
            run.out.print(line, soft_wrap=True)
        run.write(ResultsDocument(results=listed))
    run.exit(model.status for model in listed)


@cli.command()
@JSON
def paths(json_file: str | None) -> None:
    """List the ways of stepping, their options, and why one is not available here.

    \b
    Example:
      mjbench paths
    """
    from mjbench.commands.show import listings
    from mjbench.commands.show.listings import PathRow
    from mjbench.paths import registry
    from mjbench.results.json_form import ResultsDocument

    rows = [PathRow.of(path) for path in registry().values()]
    with RunContext(json_file) as run:
        run.table(listings.paths_table(rows))
        run.write(ResultsDocument(results=rows))
