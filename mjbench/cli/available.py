"""`mjbench models` and `mjbench paths`: what there is to measure."""

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.commands.shared_options import JsonOptions
from mjbench.commands.show.options import ListOptions
from mjbench.simulation.models import resolve_all, shipped


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@takes(ListOptions)
def models(names: tuple[str, ...], options: ListOptions) -> None:
    """List models: sizes, contacts and constraints at the start, timestep, integrator, solver.

    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench models
      mjbench models gymnasium:ant
    """
    from mjbench.commands.show import available
    from mjbench.commands.show.model_facts import list_models
    from mjbench.results.json_form import ResultsDocument

    sources = resolve_all(names or shipped())
    with RunContext(options, [source.path for source in sources]) as run:
        listed = list_models(sources, options.time_limit_s)
        run.table(available.models_table(listed))
        for line in available.failed_models(listed):
            run.out.print(line, soft_wrap=True)
        run.write_json(ResultsDocument(results=listed))
    run.exit(model.status for model in listed)


@cli.command()
@takes(JsonOptions)
def paths(options: JsonOptions) -> None:
    """List the ways of stepping, their options, and why one is not available here.

    \b
    Example:
      mjbench paths
    """
    from mjbench.commands.show import available
    from mjbench.commands.show.available import PathRow
    from mjbench.paths import registry
    from mjbench.results.json_form import ResultsDocument

    rows = [PathRow.of(path) for path in registry().values()]
    with RunContext(options) as run:
        run.table(available.paths_table(rows))
        run.write_json(ResultsDocument(results=rows))
