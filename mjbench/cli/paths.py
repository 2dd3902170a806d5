"""`mjbench paths`: the ways of stepping."""

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON


@cli.command()
@JSON
def paths(json_file: str | None) -> None:
    """List the ways of stepping, their options, and why one is not available here.

    \b
    Example:
      mjbench paths
    """
    from mjbench.paths import registry
    from mjbench.report import listings
    from mjbench.report.documents import PathsDocument

    rows = [listings.PathRow.of(path) for path in registry().values()]
    with RunContext(json_file) as run:
        run.table(listings.paths_table(rows))
        run.write(PathsDocument(paths=rows))
