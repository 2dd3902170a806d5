"""The table of `mjbench releases`."""

from collections.abc import Sequence

from rich.table import Table

from mjbench.releases.catalogue import ReleaseRow
from mjbench.report.tables import plain_table, yes_no


def releases_table(rows: Sequence[ReleaseRow]) -> Table:
    """Return a table of releases: where each one is."""
    table = plain_table(["release", "uploaded (UTC)", "on the index", "in the history", "here"])
    for row in rows:
        table.add_row(
            row.version,
            (row.uploaded or "unknown")[:10],
            "not asked" if row.in_index is None else yes_no(row.in_index),
            yes_no(row.in_history),
            "installed" if row.installed else "",
        )
    return table
