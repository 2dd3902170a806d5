"""Tables of what there is: models, paths and releases."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from mjbench.comparison.listing import ListedModel
from mjbench.paths import SteppingPath
from mjbench.releases.catalogue import ReleaseRow
from mjbench.report import tables
from mjbench.report.tables import yes_no


@dataclass(frozen=True)
class PathRow:
    """A way of stepping.

    Attributes:
      summary: what it is, in a few words.
      closed_loop: whether a policy can choose each control from the state before it.
      unavailable: why it cannot run here; None if it can.
      options: what each option does, by name.
    """

    path: str
    summary: str
    closed_loop: bool
    unavailable: str | None
    options: Mapping[str, str]

    @classmethod
    def of(cls, path: SteppingPath) -> "PathRow":
        """Return the row of a path."""
        return cls(
            path=path.name,
            summary=path.summary,
            closed_loop=path.closed_loop,
            unavailable=path.unavailable(),
            options={option.name: option.summary for option in path.options},
        )


def print_models(out: Console, rows: Sequence[ListedModel]) -> None:
    """Print the table of `mjbench models`, and below it a line for each model that failed."""
    sizes = ("nq", "nv", "nu", "na", "contacts", "constraints")
    headings = ["model", *sizes, "timestep", "integrator", "solver"]
    table = tables.plain_table(headings, right=range(1, 8))
    for row in rows:
        if row.facts is not None:
            numbers = [str(getattr(row.facts, size)) for size in sizes]
            timestep = f"{1e3 * row.facts.timestep:g} ms"
            names = (row.facts.integrator, row.facts.solver)
            table.add_row(row.model, *numbers, timestep, *names)
    if table.rows:
        out.print(table)
    for row in rows:
        if row.facts is None:
            reason = row.detail.removeprefix(f"{row.model}: ")
            out.print(f"{row.model}: {reason}", soft_wrap=True)


def paths_table(rows: Sequence[PathRow]) -> Table:
    """Return the table of `mjbench paths`."""
    table = tables.plain_table(["path", "closed loop", "here", "what it is", "options"])
    for row in rows:
        table.add_row(
            row.path,
            yes_no(row.closed_loop),
            row.unavailable or "yes",
            row.summary,
            ", ".join(row.options),
        )
    return table


def releases_table(rows: Sequence[ReleaseRow]) -> Table:
    """Return the table of `mjbench releases`: where each one is."""
    table = tables.plain_table(
        ["release", "uploaded (UTC)", "on the index", "in the history", "here"]
    )
    for row in rows:
        table.add_row(
            row.version,
            (row.uploaded or "unknown")[:10],
            "not asked" if row.in_index is None else yes_no(row.in_index),
            yes_no(row.in_history),
            "installed" if row.installed else "",
        )
    return table
